// SPDX-License-Identifier: Apache-2.0
//
// The life of a launch (host/README.md), between the interposer and the decision:
//
//  1 resolve()            whose launch is it? nobody's: untouched.
//  2 estimate()           E_k and U_k from the plan, by position, else by name and size.
//  3 publish              the slot in the active kernel buffer says what is about to be launched.
//  4 emit_mark()          lazily: the mark for what was launched before, once enough has been. Only
//                         ever on a stream that the program's own call names: any other may be
//                         gone.
//  5 hold_until_admitted  run-ahead within its bound, and the packed admission says go; else sleep
//                         a little and look again.
//  6 the caller launches, at the priority of the rank.
//  7 after_launch()       position and estimates move on.
//
// Numbers on the GPU's side of a task are counted in "marks": sequence numbers in the slot, with
// the GPU time that remains after each in a ring, so that any thread can tell from one progress
// word what remains of any task.
#include <algorithm>

#include "host/runtime/runtime.h"
#include "host/sched/admission.h"

namespace urgengo::runtime {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
using abi::TaskSlot;

/// A kernel that the plan does not know. Its utilisation is how much of the GPU's threads it fills.
constexpr nanoseconds kUnknownKernel{20'000};

/// A graph: what is in it is not known, so it counts as filling the GPU.
constexpr nanoseconds kGraph{1'000'000};

/// Null, legacy or per-thread: the same handle in every context.
bool is_default(CUstream stream) {
    return stream == nullptr || stream == CU_STREAM_LEGACY || stream == CU_STREAM_PER_THREAD;
}

}  // namespace

bool Runtime::schedules() const {
    return mode() == config::Mode::kEnforce && (scheduler_.admission != config::Admission::kNone ||
                                                scheduler_.binding != config::Binding::kNone);
}

model::KernelEstimate Runtime::estimate(ThreadState& thread, const TaskState& task,
                                        const Launch& launch) {
    if (!launch.function) return {kGraph, 1.0};
    model::KernelKey key{0, launch.grid_blocks, launch.block_threads};
    if (driver_.cuFuncGetName) {
        const std::uint32_t epoch = names_epoch_.load(kRelaxed);
        if (thread.names_epoch != epoch) {
            thread.names.fill({});
            thread.names_epoch = epoch;
        }
        const auto address = reinterpret_cast<std::uintptr_t>(launch.function);
        auto& cached = thread.names[(address >> 4) % ThreadState::kCachedNames];
        if (cached.function != launch.function) {
            const char* name = nullptr;
            cached = {launch.function, 0};
            if (driver_.cuFuncGetName(&name, launch.function) == CUDA_SUCCESS && name)
                cached.name_hash = fnv1a64(name);
        }
        key.name_hash = cached.name_hash;
    }
    if (const auto* known = task.plan.find(task.run.position, key)) return *known;
    const double threads = static_cast<double>(launch.grid_blocks) * launch.block_threads;
    return {kUnknownKernel, std::min(1.0, threads / task.run.marks->resident_threads)};
}

Grant Runtime::before_launch(ThreadState& thread, const Launch& launch) {
    Grant grant;
    if (mode() == config::Mode::kOff) return grant;
    if (captures_.is_capturing(launch.stream, launch.flavor)) return grant;
    TaskState* task = resolve(thread);
    if (!task) return grant;
    grant.task = task;
    TaskRun& run = task->run;
    // Another stream, or a default stream, may mean another context: marks are per context.
    if (run.on_gpu && (run.stream != launch.stream || is_default(launch.stream)) &&
        marks_.prepare() != run.marks)
        leave_gpu_segment(*task, false);
    run.stream = launch.stream;
    run.flavor = launch.flavor;
    // Without progress there is no scheduling: neither after a refused mark, nor where marks cannot
    // be.
    if (!schedules() || run.marks_refused) return grant;
    if (!run.on_gpu && !enter_gpu_segment(*task)) return grant;

    grant.scheduled = true;
    const model::KernelEstimate estimated = estimate(thread, *task, launch);
    grant.estimate = estimated.gpu_time;
    task->slot->head_utilization_ppm.store(static_cast<std::uint32_t>(estimated.utilization * 1e6),
                                           kRelaxed);
    if (launch.depends_on_previous) task->overlaps = true;
    const int rank = launch.depends_on_previous ? look(*task).rank : hold_until_admitted(*task);
    if (scheduler_.binding == config::Binding::kKernel) {
        grant.set_priority = true;
        grant.priority =
            sched::priority_of_rank(rank, run.marks->least_priority, run.marks->greatest_priority);
    }
    return grant;
}

void Runtime::after_launch(ThreadState& thread, const Launch& launch, const Grant& grant,
                           bool succeeded) {
    TaskState& task = *grant.task;
    if (!succeeded) return;
    ChainStatistics& statistics = task.chain->statistics;
    statistics.launches.fetch_add(1, kRelaxed);
    ++task.run.position;
    if (!grant.scheduled || !task.run.on_gpu) return;
    statistics.scheduled.fetch_add(1, kRelaxed);
    task.launched += grant.estimate;
    TaskSlot& slot = *task.slot;
    slot.head_remaining_ns.store(task.plan.remaining_from(task.run.position).count(), kRelaxed);
    slot.launched_ns.store(task.launched.count(), kRelaxed);
    slot.launch_ns.store(clock_.now().count(), kRelaxed);
    // A mark would end the overlap of this kernel with a next one that depends on it
    // programmatically; a task that does such things is marked only where it is held or waits.
    if (!task.overlaps && task.launched - task.marked >= scheduler_.mark_every) emit_mark(task);
}

// --- GPU segments

bool Runtime::enter_gpu_segment(TaskState& task) {
    TaskRun& run = task.run;
    run.marks = marks_.prepare();
    if (!run.marks) return false;
    CUdevice none = -1;
    if (!device_.compare_exchange_strong(none, run.marks->device, kRelaxed) &&
        none != run.marks->device)
        return false;  // another device: its work has nothing to do with ours
    TaskSlot& slot = *task.slot;
    ug_mark_line* line = &run.marks->lines[task.index];
    const std::uint32_t issued = slot.marks_issued.load(kRelaxed);
    if (task.line.load(kRelaxed) != line) {
        // First use, or another context: the line must not look like progress that never was.
        __atomic_store_n(&line->word[0], ug_mark_word0(0, 0, issued), __ATOMIC_RELAXED);
        __atomic_store_n(&line->word[1], issued & 0xffffu, __ATOMIC_RELAXED);
        slot.marks_done.store(issued, kRelaxed);
        slot.launched_at_mark_ns[issued % abi::kMarkRing].store(task.launched.count(), kRelaxed);
        task.marked = task.launched;
        task.line.store(line, std::memory_order_release);
    }
    run.position_at_mark[issued % abi::kMarkRing] = run.position;
    const nanoseconds now = clock_.now();
    slot.look_ns.store(now.count(), kRelaxed);
    slot.progress_ns.store(now.count(), kRelaxed);
    slot.state.store(abi::TaskState::kGpu, std::memory_order_release);
    page_->on_gpu.fetch_add(1, kRelaxed);
    run.on_gpu = true;
    return true;
}

void Runtime::leave_gpu_segment(TaskState& task, bool idle) {
    if (!task.run.on_gpu) return;
    task.run.on_gpu = false;
    TaskSlot& slot = *task.slot;
    if (idle) {
        const std::uint32_t issued = slot.marks_issued.load(kRelaxed);
        slot.launched_at_mark_ns[issued % abi::kMarkRing].store(task.launched.count(), kRelaxed);
        task.marked = task.launched;
    }
    slot.state.store(abi::TaskState::kCpu, std::memory_order_release);
    page_->on_gpu.fetch_sub(1, kRelaxed);
}

void Runtime::emit_mark(TaskState& task) {
    TaskRun& run = task.run;
    if (captures_.is_capturing(run.stream, run.flavor) || marks_.prepare() != run.marks) return;
    TaskSlot& slot = *task.slot;
    const std::uint32_t sequence = slot.marks_issued.load(kRelaxed) + 1;
    // The ring's entry is complete before the GPU can execute the mark.
    run.position_at_mark[sequence % abi::kMarkRing] = run.position;
    slot.launched_at_mark_ns[sequence % abi::kMarkRing].store(task.launched.count(), kRelaxed);
    if (slot.marks_done.load(kRelaxed) == sequence - 1)
        slot.progress_ns.store(clock_.now().count(), kRelaxed);
    const std::uint64_t word0 = ug_mark_word0(
        run.position, static_cast<std::uint16_t>(slot.instance.load(kRelaxed)), sequence);
    if (marks_.launch(*run.marks, task.index, word0, sequence, run.stream, run.flavor) !=
        CUDA_SUCCESS) {
        run.marks_refused = true;
        task.chain->statistics.marks_refused.fetch_add(1, kRelaxed);
        leave_gpu_segment(task, false);
        return;
    }
    slot.marks_issued.store(sequence, std::memory_order_release);
    task.marked = task.launched;
    task.chain->statistics.marks.fetch_add(1, kRelaxed);
}

bool Runtime::waits_for_task(const ThreadState& thread, CUstream stream,
                             exec::StreamFlavor flavor) {
    const TaskState* task = thread.task;
    return task && task->run.stream == stream && (stream || task->run.flavor == flavor);
}

void Runtime::before_wait(ThreadState& thread, CUstream stream, exec::StreamFlavor flavor) {
    TaskState* task = thread.task;
    if (!task || !task->run.on_gpu || task->launched == task->marked) return;
    // On the legacy stream a mark is a barrier for what other threads have launched since.
    const bool legacy =
        stream == CU_STREAM_LEGACY || (stream == nullptr && flavor == exec::StreamFlavor::kLegacy);
    if (!legacy && waits_for_task(thread, stream, flavor)) emit_mark(*task);
}

void Runtime::after_wait(ThreadState& thread, bool for_task) {
    thread.name_is_fresh = false;
    TaskState* task = thread.task;
    if (!task || !for_task) return;
    leave_gpu_segment(*task, true);
    if (!thread.hinted) end_named_run(thread, clock_.now());
}

// --- holding

Runtime::Look Runtime::look(TaskState& task) {
    TaskSlot& slot = *task.slot;
    const nanoseconds now = clock_.now();
    slot.look_ns.store(now.count(), kRelaxed);

    std::array<model::SlotView, abi::kMaxTasks> views;
    std::size_t num_views = 0;
    views[num_views++] = model::read_slot(slot, task.line.load(kRelaxed), task.index, now);
    if (page_->on_gpu.load(kRelaxed) > 1) {
        for (const auto& other : tasks_) {
            if (other.get() == &task) continue;
            const auto view = model::read_slot(
                *other->slot, other->line.load(std::memory_order_acquire), other->index, now);
            if (view.ranked) views[num_views++] = view;
        }
    }
    const sched::Snapshot snapshot{now, {views.data(), num_views}};
    const sched::Decision decision = sched::decide(scheduler_, snapshot);

    Look result;
    result.rank = decision.rank;
    result.admitted = decision.admit;
    // Two kernels may always be queued: the GPU never waits for our poll between them.
    const std::uint32_t done = slot.marks_done.load(kRelaxed);
    const std::uint32_t queued =
        task.run.position - task.run.position_at_mark[done % abi::kMarkRing];
    // And what waits for something other than the GPU may be waiting for this very launch.
    result.within_run_ahead = snapshot.self().launched <= scheduler_.run_ahead || queued < 2 ||
                              snapshot.self().overdue ||
                              scheduler_.admission == config::Admission::kNone;
    return result;
}

int Runtime::hold_until_admitted(TaskState& task) {
    TaskRun& run = task.run;
    const nanoseconds bound = scheduler_.hold_max_per_instance.count() > 0
                                  ? scheduler_.hold_max_per_instance
                                  : task.chain->config.deadline;
    // An instance that has been held for its bound is held for others no more; its own run-ahead
    // still paces it, and its rank still gives it a low priority.
    const auto must_wait = [&](const Look& l) {
        return (!l.admitted && run.held < bound) || (!l.within_run_ahead && run.paced < bound);
    };
    Look now = look(task);
    if (!must_wait(now)) return now.rank;

    TaskSlot& slot = *task.slot;
    ChainStatistics& statistics = task.chain->statistics;
    // What is launched must be visible while we wait: to the others, and to our own run-ahead.
    if (task.launched != task.marked) emit_mark(task);
    if (!run.on_gpu) return now.rank;  // the mark was refused
    if (!now.admitted) statistics.holds.fetch_add(1, kRelaxed);
    slot.state.store(abi::TaskState::kHeld, kRelaxed);
    {
        const FineTimerSlack slack;
        nanoseconds last = clock_.now();
        while (must_wait(now) && schedules()) {
            clock_.sleep_for(scheduler_.hold_poll);
            const nanoseconds time = clock_.now();
            if (now.admitted || run.held >= bound) {
                run.paced += time - last;
            } else {
                run.held += time - last;
                statistics.held_ns.fetch_add((time - last).count(), kRelaxed);
                if (run.held >= bound) statistics.holds_opened.fetch_add(1, kRelaxed);
            }
            last = time;
            now = look(task);
        }
    }
    slot.state.store(abi::TaskState::kGpu, kRelaxed);
    return now.rank;
}

}  // namespace urgengo::runtime
