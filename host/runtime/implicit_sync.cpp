// SPDX-License-Identifier: Apache-2.0
//
// Calls that wait for all work of the context on their way: cuMemFree and its like, and
// cuCtxSynchronize. While a task's thread is in one, all that others have on the GPU is in its way.
// So for that long its slot says that it needs the whole GPU: who is less urgent launches nothing
// more, and what is there drains. The thread itself is held by nobody.
//
// Bounded: when twice the GPU time that is under way has passed, and a millisecond, it waits for
// something else (a launch that we hold, say, through a value in memory), and blocks nobody.
#include "host/runtime/runtime.h"

namespace urgengo::runtime {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;

}  // namespace

void Runtime::implicit_sync_begins(ThreadState& thread) {
    TaskState* task = own_task(thread);
    if (!task || !schedules() || page_->on_gpu.load(kRelaxed) == 0) return;
    const exec::MarkContext* context = marks_.prepare();
    if (!context) return;
    const nanoseconds now = clock_.now();
    nanoseconds under_way{0};
    for (const auto& other : tasks_) {
        const ug_mark_line* line = other->line.load(std::memory_order_acquire);
        if (line == &context->lines[other->index])  // else it is in another context's way
            under_way += model::read_slot(*other->slot, line, other->index, now).launched;
    }
    if (under_way.count() == 0 || !take(thread, *task)) return;
    TaskRun& run = task->run;
    if (!run.observed && !run.in_sync) {
        run.in_sync = true;
        abi::TaskSlot& slot = *task->slot;
        slot.sync_until_ns.store((now + 2 * under_way + model::kOverdue).count(), kRelaxed);
        slot.state.store(abi::TaskState::kSync, std::memory_order_release);
        run.sync_counted = !run.on_gpu;
        if (run.sync_counted) page_->on_gpu.fetch_add(1, kRelaxed);
        page_->changes.fetch_add(1, kRelaxed);
        bump(task->counters.implicit_syncs);
    }
    release(thread);
}

void Runtime::implicit_sync_ended(ThreadState& thread) {
    TaskState* task = own_task(thread);
    if (!task) return;
    task->sync_end_is_due.store(true);
    finish_due(*task);  // or whoever is at the task does, when it lets go
}

void Runtime::leave_implicit_sync(TaskState& task) {
    TaskRun& run = task.run;
    if (!run.in_sync) return;
    run.in_sync = false;
    task.slot->state.store(run.on_gpu ? abi::TaskState::kGpu : abi::TaskState::kCpu,
                           std::memory_order_release);
    if (run.sync_counted) page_->on_gpu.fetch_sub(1, kRelaxed);
    page_->changes.fetch_add(1, kRelaxed);
}

}  // namespace urgengo::runtime
