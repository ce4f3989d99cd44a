// SPDX-License-Identifier: Apache-2.0
//
// Whose launch is it? In this order:
//
//  1 a hint in force on the thread;
//  2 the innermost NVTX range that some task's `nvtx:` names: the range is the instance;
//  3 what the thread's name and the kernel at a burst's begin say: among the tasks whose `thread:`
//    pattern fits, the one whose `kernels:` pattern, or whose first kernel in the profile, fits;
//    what a task in progress expects next comes first. The name is read again after each wait:
//    pools rename and reuse threads;
//  4 for a thread that matches nothing, a helper: the only task that uses the stream.
//
// A burst, from its first launch to a wait for it, is of one task. A task whose run another thread
// has begun is joined if that run was hinted and not yet launched for, or on the same stream.
#include "host/runtime/resolver.h"

#include <algorithm>
#include <string>

#include "host/base/memory_orders.h"
#include "host/observe/nvtx_ranges.h"

namespace urgengo::runtime {
namespace {

/// After so long the program waits for its work in a way that we do not see.
/// What our holds have added to the instance is none of its program's.
nanoseconds lasted(const TaskState& task, nanoseconds now) {
    const sched::GovernedRun::Waited& waited = task.run.waited;
    return now - task.tracked.begin - waited.held - waited.paced;
}

nanoseconds longest_run(const TaskState& task) {
    return task.plan.segments().empty() ? task.chain->longest() : task.chain->abandoned_after();
}

}  // namespace

Resolver::Resolver(Common& common, Runs& runs, Frames& frames, WorkOnStreams& streams)
    : common_(common), runs_(runs), frames_(frames), streams_(streams) {
    for (const auto& task : common_.roster.tasks())
        names_.add_task(task->index, task->known_by.config,
                        task->chain->config.mode == config::Mode::kOff);
}

model::Fit Resolver::begins(const TaskState& task, const model::KernelKey& key,
                            const identity::KnownKernel* kernel) {
    if (!task.known_by.config.kernels.empty()) {
        if (!kernel || !kernel->begins || !kernel->begins->contains(task.index))
            return model::Fit::kNone;
        // The name fits some pattern; the size must fit one, too. Which one is not told apart.
        const bool fits =
            std::any_of(task.known_by.config.kernels.begin(), task.known_by.config.kernels.end(),
                        [&](const auto& p) {
                            return (p.grid_blocks == 0 || p.grid_blocks == key.grid_blocks) &&
                                   (p.block_threads == 0 || p.block_threads == key.block_threads);
                        });
        return fits ? model::Fit::kExact : model::Fit::kNone;
    }
    return task.plan.segments().empty() ? model::Fit::kOtherSize : task.plan.begins_segment(0, key);
}

TaskState* Resolver::choose(ThreadState& thread, const model::KernelKey& key,
                            const identity::KnownKernel* kernel, bool expected) const {
    TaskState* const current = thread.task;
    if (current && expected) return current;
    TaskState* best = nullptr;
    auto best_fit = model::Fit::kNone;
    const auto consider = [&](TaskState* task) {
        const model::Fit fit = begins(*task, key, kernel);
        if (fit > best_fit) {
            best = task;
            best_fit = fit;
        }
    };
    const identity::NamedThread& named = thread.serves.named;
    const auto candidate = [&](int i) {
        return &common_.roster.task(named.candidates[static_cast<std::size_t>(i)]);
    };
    // In order, from the one after the last that ran here: without a profile, tasks take turns.
    int first = 0;
    for (int i = 0; i < named.num_candidates; ++i)
        if (named.candidates[static_cast<std::size_t>(i)] == named.last) first = i + 1;
    for (int i = 0; i < named.num_candidates; ++i)
        consider(candidate((first + i) % named.num_candidates));
    if (current && best_fit != model::Fit::kExact) return current;
    if (best) return best;
    // The only task of this thread, begun with a kernel that the profile does not know: it is
    // followed all the same, and loses confidence.
    TaskState* const only = named.num_candidates == 1 ? candidate(0) : nullptr;
    return only && only->known_by.config.kernels.empty() ? only : nullptr;
}

TaskState* Resolver::resolve(ThreadState& thread, const Launch& launch, const model::KernelKey& key,
                             const identity::KnownKernel* kernel, nanoseconds now) {
    TaskState* task = Runs::own_task(thread);
    if (thread.serves.uses_hints || thread.serves.ranged) {
        if (!task || !runs_.take_own(thread, *task)) return nullptr;
        task->tracker.launch(key);
        streams_.used_by(*task, launch.stream);
        return task;
    }
    bool expected = false;
    if (task) {
        // A helper of ours may be at it. Looked at only while no other thread is.
        if (!runs_.take_own(thread, *task)) return nullptr;
        const bool in_burst = task->tracker.in_segment();
        const bool too_long = lasted(*task, now) > longest_run(*task);
        if (in_burst && !too_long) [[likely]]
            return follow(thread, *task, launch, key, now);
        expected = task->tracker.expects(key) == model::Fit::kExact;
        runs_.release(thread);
        if (in_burst) {
            // A program that waits for its work in a way that we do not see never ends its
            // instance. Not for ever: it would rank as late for good.
            frames_.end(thread, now, task->plan.segments().empty());
        } else {
            task = nullptr;
        }
    }
    if (!task) {
        if (!thread.serves.name_is_fresh) read_thread_name(thread);
        if (thread.serves.named.num_candidates > 0) task = choose(thread, key, kernel, expected);
        if (!task) {
            task = join(thread, nullptr, launch, key);
            const bool helper = streams_.owner(launch.stream) != nullptr;
            if (!task && thread.serves.named.num_candidates == 0 && !helper)
                let_pass(thread, launch.stream);
            return task;
        }
    }
    if (task != thread.task) {
        if (thread.task) frames_.end(thread, now, false);
        if (!frames_.begin(thread, *task, now)) return join(thread, task, launch, key);
    }
    return runs_.take_own(thread, *task) ? follow(thread, *task, launch, key, now) : nullptr;
}

// The thread has taken its task.
TaskState* Resolver::follow(ThreadState& thread, TaskState& task, const Launch& launch,
                            const model::KernelKey& key, nanoseconds now) {
    if (task.tracker.launch(key) == model::InstanceTracker::Step::kEndAndBegin) {
        runs_.release(thread);
        frames_.end(thread, now, false);
        if (!frames_.begin(thread, task, now) || !runs_.take_own(thread, task)) return nullptr;
        task.tracker.launch(key);
    }
    streams_.used_by(task, launch.stream);
    return &task;
}

// For a thread that has begun no run: a helper of another thread's.
TaskState* Resolver::join(ThreadState& thread, TaskState* task, const Launch& launch,
                          const model::KernelKey& key) {
    if (!task && !exec::is_default_stream(launch.stream)) task = streams_.owner(launch.stream);
    if (!task || !runs_.take(thread, *task)) return nullptr;
    const sched::GovernedRun& run = task->run;
    const TrackedRun& tracked = task->tracked;
    const bool same_stream = run.position > 0 && tracked.stream == launch.stream && launch.stream;
    const bool joins = task->taking.owner.load(kRelaxed) != nullptr &&
                       !task->taking.end_is_due.load(kRelaxed) &&
                       (same_stream || (tracked.hinted && run.position == 0));
    if (!joins) {
        runs_.release(thread);
        return nullptr;
    }
    task->tracker.launch(key);
    return task;
}

bool Resolver::may_be_chains(const ThreadState& thread, const Launch& launch) const {
    return thread.task || thread.serves.hinted || thread.serves.named.num_candidates > 0 ||
           streams_.owner(launch.stream) != nullptr;
}

bool Resolver::take_own(ThreadState& thread, TaskState& task) {
    return Runs::own_task(thread) == &task && runs_.take_own(thread, task);
}

// As resolve() finds a launch's task, without the kernel that would tell one candidate from
// another. The name is read again at the next launch as if it had not been read here.
TaskState* Resolver::copying_task(ThreadState& thread) {
    if (TaskState* task = Runs::own_task(thread)) return task;
    if (thread.serves.uses_hints || thread.serves.ranged) return nullptr;
    const bool was_fresh = thread.serves.name_is_fresh;
    if (!was_fresh) read_thread_name(thread);
    let_pass_if_bystander(thread);
    thread.serves.name_is_fresh = was_fresh;
    const identity::NamedThread& named = thread.serves.named;
    return named.num_candidates > 0 ? &common_.roster.task(named.candidates[0]) : nullptr;
}

// A thread that waits or records events without ever launching.
void Resolver::let_pass_if_bystander(ThreadState& thread) {
    if (thread.serves.uses_hints || thread.serves.ranged || thread.line.waits_to_pass > 0) return;
    if (thread.serves.named.num_candidates > 0) return;  // its name is read again when it launches
    if (!thread.serves.name_is_fresh) read_thread_name(thread);
    // Its launches are still asked about: on which streams it will make them is not known.
    static const auto kNoStream = reinterpret_cast<CUstream>(~std::uintptr_t{0});
    if (thread.serves.named.num_candidates == 0) let_pass(thread, kNoStream);
}

void Resolver::range_pushed(ThreadState& thread, std::string_view name) {
    if (common_.tracer.is_on()) common_.tracer.range(thread, name);
    if (names_.knows_ranges()) follow_ranges(thread);
}

void Resolver::range_popped(ThreadState& thread) {
    if (common_.tracer.is_on()) common_.tracer.range(thread, {});
    if (names_.knows_ranges()) follow_ranges(thread);
}

void Resolver::follow_ranges(ThreadState& thread) {
    if (thread.serves.uses_hints || common_.mode() == config::Mode::kOff) return;
    TaskState* task = nullptr;
    if (const auto* ranges = observe::this_thread_ranges())
        ranges->innermost([&](std::string_view name, std::uint64_t) {
            const int index = names_.task_of_range(std::string(name));
            if (index >= 0) task = &common_.roster.task(index);
            return task != nullptr;
        });
    if (!task && !thread.serves.ranged) return;  // none of ours: neither entered nor left
    if (thread.serves.ranged && thread.task == task) return;
    const nanoseconds now = common_.clock.now();
    if (Runs::own_task(thread)) frames_.end(thread, now, true);
    thread.serves.ranged = false;
    if (!task || task->chain->mode() == config::Mode::kOff) return;
    thread.line.passes = false;
    thread.serves.ranged = frames_.begin(thread, *task, now);
}

// What this thread launches is of no chain, so its next calls need not ask. That ends with a hint,
// an NVTX range or a new name. The name is read again after as many waits as it was found
// unchanged, at most 1024. (Reading it costs 200 ns; a pool's thread gets its name early.)
//
// Where gates may be closed each call asks: it may be one that would wait for them.
void Resolver::let_pass(ThreadState& thread, CUstream stream) const {
    if (common_.tracer.is_on() || common_.gate_keeper.are_on()) return;
    // A count under way goes on: the thread may launch on several streams in turn.
    if (thread.line.waits_to_pass == 0) thread.line.waits_to_pass = thread.serves.named.patience;
    thread.line.passes_stream = stream;
    thread.line.passes = true;
}

void Resolver::read_thread_name(ThreadState& thread) {
    thread.serves.name_is_fresh = true;
    names_.read(thread.serves.named);
}

}  // namespace urgengo::runtime
