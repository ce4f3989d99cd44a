// SPDX-License-Identifier: Apache-2.0
//
// Instances: their begins and ends, told by hints or by what the threads do.
//
// Without hints: an instance of a task begins with a launch and ends with a wait (which ones says
// model/instance_tracker). It has arrived as long before its first call as the thread has computed
// since its last wait (identity/last_wait.h). Through the chain the instance is handed on in order:
// what a later task works on is the oldest that the task before it has finished
// (identity/instances.h).
#include <algorithm>
#include <memory>
#include <optional>
#include <utility>

#include "host/config/limits.h"
#include "host/model/arrival_stamp.h"
#include "host/runtime/runtime.h"
#include "host/sched/instance_slot.h"

namespace urgengo::runtime {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
/// An instance that did not go as planned counts for an eighth of the task's confidence.
constexpr double kConfidenceStep = 1.0 / 8;
/// Below this a task without hints is observed only. Three bad instances in a row do it.
constexpr double kMinConfidence = 0.7;
}  // namespace

nanoseconds Runtime::longest_run(const TaskState& task) {
    return task.plan.segments().empty() ? task.chain->longest() : task.chain->abandoned_after();
}

// --- hints

std::uint64_t Runtime::arrival(ThreadState* thread, const char* chain_name, nanoseconds when) {
    ChainState* const chain = common_.roster.find_chain(chain_name);
    if (!chain || common_.mode() == config::Mode::kOff) return 0;
    const nanoseconds now = common_.clock.now();
    if (!model::is_plausible(when, now, chain->config.period, chain->abandoned_after())) {
        chain->statistics.implausible.fetch_add(1, kRelaxed);
        when = now;
    }
    const std::uint64_t token = instances_.arrived(chain->index, when);
    enter(*chain, when);
    if (common_.tracer.is_on() && thread)
        common_.tracer.hint(*thread, abi::TraceKind::kArrival, static_cast<int>(chain->index),
                            token, when);
    return token;
}

bool Runtime::task_begin(ThreadState& thread, std::uint64_t token, const char* task_name) {
    task_end(thread);
    leave_task(thread);
    const Instance instance = instances_.find(token);
    if (instance.token == 0) return false;
    TaskState* const task = common_.roster.find_task(*instance.chain, task_name);
    if (!task) return false;

    const nanoseconds now = common_.clock.now();
    if (sched::is_lost(common_.governor.tasks(), *task, instance.arrival, now) &&
        instance.chain->config.on_late == config::OnLate::kExit &&
        instance.chain->config.mode == config::Mode::kEnforce &&
        !common_.guard.observes(instance.chain->index) &&
        common_.mode() == config::Mode::kEnforce) {
        instance.chain->exited(instance.arrival, now);
        tell_guard(*instance.chain, sched::kExitedDeadlines * instance.chain->config.deadline, now);
        instances_.forget(token);
        return true;
    }
    // From here on the thread's launches are this task's, or (if another thread has it) nobody's.
    thread.serves.uses_hints = thread.serves.hinted = true;
    thread.line.passes = false;
    thread.serves.instance = instance;
    thread.serves.last_task = task->index == instance.chain->tasks.back();
    if (common_.tracer.is_on())
        common_.tracer.hint(thread, abi::TraceKind::kTaskBegin, task->index, token,
                            instance.arrival);
    if (claim(thread, *task)) begin_run(thread, *task, instance.arrival, now, true);
    return false;
}

void Runtime::task_end(ThreadState& thread) {
    if (!thread.serves.hinted) return;
    if (common_.tracer.is_on())
        common_.tracer.hint(thread, abi::TraceKind::kTaskEnd, thread.task ? thread.task->index : -1,
                            thread.serves.instance.token, nanoseconds{0});
    leave_task(thread);
    if (!thread.serves.last_task) return;
    finish_instance(*thread.serves.instance.chain, thread.serves.instance.arrival,
                    common_.clock.now());
    instances_.forget(thread.serves.instance.token);
}

void Runtime::leave_task(ThreadState& thread) {
    thread.serves.hinted = false;
    thread.serves.name_is_fresh = false;
    if (own_task(thread)) end_run(thread, *thread.task);
}

void Runtime::finish_instance(ChainState& chain, nanoseconds arrival, nanoseconds now) {
    chain.finished(arrival, now);
    tell_guard(chain, now - arrival, now);
}

void Runtime::enter(ChainState& chain, nanoseconds arrival) {
    chain.entered(arrival, common_.governor.waited_at());
    if (common_.mode() == config::Mode::kEnforce) common_.guard.frame_began(chain.index, arrival);
}

void Runtime::tell_guard(const ChainState& chain, nanoseconds latency, nanoseconds now) {
    if (mode() != config::Mode::kEnforce) return;
    if (!guard_.frame_ended(chain.index, latency, governor_.bystanders().are_busy(), now)) return;
    governor_.tasks().changed();
}

// --- runs

bool Runtime::claim(ThreadState& thread, TaskState& task) {
    ThreadState* nobody = nullptr;
    if (!task.taking.owner.compare_exchange_strong(nobody, &thread, std::memory_order_acquire))
        return false;
    // A helper of the last run may have come too late, and be about to find that out.
    if (!take(thread, task)) {
        task.taking.owner.store(nullptr, std::memory_order_release);
        return false;
    }
    thread.task = &task;
    return true;
}

// The thread has claimed the task; it lets go of it here.
void Runtime::begin_run(ThreadState& thread, TaskState& task, nanoseconds arrival, nanoseconds now,
                        bool hinted) {
    thread.serves.chains.serve(static_cast<int>(task.slot->chain.load(kRelaxed)), now);
    task.known_by.matched.store(true, kRelaxed);
    task.unasked.counted.store(task.slot->as_planned.load(kRelaxed), kRelaxed);
    std::construct_at(&task.run);  // in its place: it is six cache lines
    task.tracked = {};
    task.batches.waited_in_vain = false;
    task.streams.begin_run(num_launched(task));
    task.tracked.arrival = arrival;
    task.tracked.begin = now;
    task.waits.store(false, kRelaxed);
    task.tracked.hinted = hinted;
    if (hinted) task.tracked.cpu_begin = now;  // without hints it begins with a launch
    task.run.observed = task.chain->config.mode != config::Mode::kEnforce ||
                        common_.guard.observes(task.chain->index) ||
                        (!hinted && task.known_by.confidence < kMinConfidence);
    if (task.run.observed) common_.governor.company().unmarked_begins(now);
    task.is_unseen.store(task.run.observed, kRelaxed);
    if (task.run.observed || !hinted) task.chain->expectation.launched(arrival, now);
    task.tracker = model::InstanceTracker(task.plan);
    if (common_.tracer.is_on()) {
        const int flags =
            (hinted ? abi::kTraceHinted : 0) | (task.run.observed ? abi::kTraceObserved : 0);
        common_.tracer.instance(thread, task, abi::TraceKind::kInstanceBegin, now, flags);
    }

    const nanoseconds served = task.chain->bandwidth.served(arrival);
    sched::begin_instance(common_.governor.tasks(), task,
                          served_deadline(thread, served + task.chain->config.deadline, now),
                          still_to_launch(task), still_idle(task), now);
    if (TaskState* const other = std::exchange(thread.waits.lends_to, nullptr);
        other && other != &task)
        lend_along(task, *other, thread.waits.lends_until);
    release(thread);
}

// One thread may serve several chains: what it holds up, it holds up for all of them.
nanoseconds Runtime::served_deadline(ThreadState& thread, nanoseconds own, nanoseconds now) {
    nanoseconds earliest = own;
    const auto chain_at = [&](int i) -> const ChainState& {
        return *common_.roster.chains()[static_cast<std::size_t>(i)];
    };
    const auto period_of = [&](int i) { return chain_at(i).longest(); };
    int num_served = 0;
    thread.serves.chains.for_each(now, period_of, [&](int i) {
        ++num_served;
        const config::Chain& chain = chain_at(i).config;
        const nanoseconds last(chain_at(i).last_arrival_ns.load(kRelaxed));
        if (last.count() == 0) return;
        // Its last frame may still wait for this thread; if not, its next one will.
        const nanoseconds next = last + chain.period + chain.deadline;
        if (next > now) earliest = std::min(earliest, next);
    });
    if (num_served <= 1) return own;
    return earliest;
}

// The owner ends its run. A helper that is at it, held perhaps, ends it in its place.
void Runtime::end_run(ThreadState& thread, TaskState& task) {
    thread.task = nullptr;
    thread.line.ask_again();  // whoever may still be at the task
    if (common_.tracer.is_on()) {
        const int flags = (task.tracked.hinted ? abi::kTraceHinted : 0) |
                          (task.tracker.fits() ? 0 : abi::kTraceResync);
        common_.tracer.instance(thread, task, abi::TraceKind::kInstanceEnd, common_.clock.now(),
                                flags);
    }
    task.taking.end_is_due.store(true);
    finish_due(task);
}

// Unless somebody is at the task: then that thread will, when it lets go.
void Runtime::finish_due(TaskState& task) {
    do {
        if (task.taking.busy.exchange(true)) return;
        segments_.catch_up(task);
        if (task.taking.sync_end_is_due.exchange(false)) leave_implicit_sync(task);
        if (task.taking.end_is_due.exchange(false)) {
            leave_implicit_sync(task);
            segments_.leave(task, false);
            if (task.run.observed) common_.governor.company().unmarked_ends();
            task.cpu.end_instance(0);
            task.cpu_time_ns.store(task.cpu.total().count(), kRelaxed);
            if (task.learning && !task.run.observed && task.run.position > 0) {
                model::Durations& durations = task.learning->durations();
                durations.end_instance(task.run.position);
                task.gpu_time_ns.store(durations.remaining_from(0).count(), kRelaxed);
            }
            instance_measured(task);
            task.slot->state.store(abi::TaskState::kIdle, kRelaxed);
            common_.governor.gives_up_waiting(
                task);  // its thread may have ended, or jumped, in a hold
            common_.governor.tasks().set_active(task, false);
            task.taking.owner.store(nullptr, std::memory_order_release);
        }
        task.taking.busy.store(false);
        // Another end may have become due while we had the task.
    } while (task.taking.end_is_due.load() || task.taking.sync_end_is_due.load());
}

void Runtime::thread_exit(ThreadState& thread) {
    if (thread.at_task) {  // cancelled inside a call
        thread.at_task->taking.held_frame = nullptr;
        common_.governor.plan().release_if_by(*thread.at_task);
        release(thread);
    }
    leave_task(thread);
    common_.tracer.thread_ends(thread);
    common_.streams.thread_ends();
}

// --- without hints

// For the arrival of what comes next. Threads that give hints tell it themselves.
void Runtime::note_end_of_wait(ThreadState& thread, nanoseconds now) {
    if (thread.serves.named.num_candidates > 0 && !thread.serves.uses_hints)
        thread.waits.last_wait.ended(now);
}

/// @returns when the frame has arrived that the thread begins with
nanoseconds Runtime::enter_chain(const ThreadState& thread, TaskState& task, nanoseconds now) {
    ChainState& chain = task.its_chain();
    const identity::LastWait::Frame frame = thread.waits.last_wait.next_frame(chain, now);
    const bool is_passed_on = chain.tasks.size() > 1;  // else there is nobody to hand it on to
    if (is_passed_on) {
        const auto slept_since =
            frame.slept ? std::optional(thread.waits.last_wait.end()) : std::nullopt;
        if (const auto arrival = instances_.taken_over(chain.index, task.stage, slept_since))
            return *arrival;
    }
    enter(chain, frame.arrival);
    if (is_passed_on) instances_.entered(chain.index, task.stage, frame.arrival);
    return frame.arrival;
}

bool Runtime::begin_named_run(ThreadState& thread, TaskState& task, nanoseconds now) {
    if (task.chain->config.arrival == config::ArrivalFrom::kHint) return false;
    if (task.taking.owner.load(kRelaxed) != nullptr) end_abandoned_run(thread, task, now);
    if (!claim(thread, task)) return false;
    begin_run(thread, task, enter_chain(thread, task, now), now, false);
    thread.serves.named.last = task.index;
    if (task.run.observed && task.chain->config.mode == config::Mode::kEnforce &&
        !common_.guard.observes(task.chain->index))
        task.its_chain().statistics.observed.fetch_add(1, kRelaxed);
    return true;
}

// A thread that launched once (a warm-up, say) and never again must not keep its task from others.
// It finds out when it comes back (own_task).
void Runtime::end_abandoned_run(ThreadState& thread, TaskState& task, nanoseconds now) {
    if (!take(thread, task)) return;
    if (!task.tracked.hinted && now - task.tracked.begin > task.chain->abandoned_after())
        task.taking.end_is_due.store(true);
    release(thread);
}

void Runtime::end_named_run(ThreadState& thread, nanoseconds now, bool as_planned) {
    TaskState& task = *thread.task;
    const nanoseconds arrival = task.tracked.arrival;
    if (!as_planned) task.its_chain().statistics.resyncs.fetch_add(1, kRelaxed);
    task.known_by.confidence +=
        kConfidenceStep * ((as_planned ? 1.0 : 0.0) - task.known_by.confidence);
    end_run(thread, task);
    if (task.chain->tasks.size() > 1)
        instances_.handed_on(task.chain->index, task.stage, arrival, now);
    if (task.index == task.chain->tasks.back()) finish_instance(task.its_chain(), arrival, now);
}

}  // namespace urgengo::runtime
