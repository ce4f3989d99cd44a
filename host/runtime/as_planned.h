// SPDX-License-Identifier: Apache-2.0
//
// Launches that need no asking, as their thread makes them; which ones those are, and why, says
// planned_launches.cpp. Inline, and all that they touch is on four cache lines: the thread's, the
// plan's entry (without a plan, the last launch's), the slot's head, SharedPage::changes. In a
// program that fills its caches with other things, what a launch costs is the lines that it takes
// from the program; with a question it would be some 300. The entry's line is one that no thread
// has touched since the last instance, so it is asked for a launch before; and a branch that is
// taken is one that the CPU has forgotten, so there are few.
//
// @threads the task's owner
#pragma once

#include "host/base/memory_orders.h"
#include "host/runtime/thread_state.h"

namespace urgengo::runtime {

/// @returns whether a launch that asks for nothing of its own is the next one that was allowed, and
///          nothing has changed: it may go at once, among others if they reckon with it. Mostly:
///          PlannedLaunches::goes() knows for sure.
inline bool is_next_planned(const ThreadLine& thread, const void* function,
                            std::uint64_t grid_blocks, std::uint32_t block_threads, CUstream stream,
                            exec::StreamFlavor flavor) {
    const ThreadLine::AsPlanned& planned = thread.as_planned;
    if (planned.left == 0) [[unlikely]]
        return false;
    // After a change the kernel may be another thread's.
    if (planned.page->changes.load(std::memory_order_relaxed) != planned.changes) [[unlikely]]
        return false;
    // Not one after the other: a branch for all.
    const model::PlannedKernel& kernel = *planned.kernel;
    return (thread.stream == stream) & (thread.flavor == flavor) & (kernel.function == function) &
           (kernel.key.grid_blocks == grid_blocks) & (kernel.key.block_threads == block_threads);
}

/// Before the launch: what it takes of the GPU.
inline void publish_next_planned(const ThreadLine& thread) {
    const ThreadLine::AsPlanned& planned = thread.as_planned;
    planned.slot->head_utilization_ppm.store(planned.kernel->utilization_ppm,
                                             std::memory_order_relaxed);
}

/// After it, if it succeeded.
inline void went_as_planned(ThreadLine& thread) {
    ThreadLine::AsPlanned& planned = thread.as_planned;
    abi::TaskSlot& slot = *planned.slot;
    const nanoseconds estimate = planned.kernel->gpu_time;
    const nanoseconds remaining = planned.kernel->remaining - estimate;
    const std::int64_t idle_ns = planned.kernel->idle_after_ns;
    planned.kernel += planned.has_plan;
    __builtin_prefetch(planned.kernel);
    ++thread.launches;
    planned.left -= planned.left != 0;  // ask_again() may have come during the launch
    slot.head_remaining_ns.store(remaining.count(), kRelaxed);
    slot.head_idle_ns.store(idle_ns, kRelaxed);
    const std::int64_t more_ns = planned.is_observed ? 0 : estimate.count();  // it is in no count
    slot.launched_ns.store(slot.launched_ns.load(kRelaxed) + more_ns, kRelaxed);
    slot.as_planned.store(slot.as_planned.load(kRelaxed) + 1, std::memory_order_release);
}

}  // namespace urgengo::runtime
