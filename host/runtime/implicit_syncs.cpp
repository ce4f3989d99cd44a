// SPDX-License-Identifier: Apache-2.0
//
// Calls that wait for all work of the context: cuMemFree and its like, cuCtxSynchronize, and the
// first launch of a kernel, which may load it. While a task's thread is in such a call, it waits
// for all that other tasks have on the GPU. So for that long its slot says that the task needs the
// whole GPU: less urgent tasks launch nothing more, and what they have there drains. The thread
// itself is never held.
//
// Bounded: after twice the GPU time that is under way, and a millisecond, the call waits for
// something else (a launch that we hold, say, through a value in memory), and blocks no other task.
#include "host/runtime/implicit_syncs.h"

#include "host/base/memory_orders.h"
#include "host/sched/instance_slot.h"

namespace urgengo::runtime {
bool ImplicitSyncs::enter(TaskState& task) {
    sched::GovernedRun& run = task.run;
    if (run.observed || run.sync.waits || !task.chain->may_be_scheduled()) return false;
    const exec::MarkContext* context = common_.marks.prepare();
    if (!context) return false;
    const nanoseconds now = common_.clock.now();
    nanoseconds under_way{0};
    for (const auto& other : common_.roster.tasks()) {
        const ug_mark_line* line = other->line.load(std::memory_order_acquire);
        if (line == &context->lines[other->index])  // else it is in another context's way
            under_way += common_.governor.tasks().look(*other, line, now).ahead.launched;
    }
    if (under_way.count() == 0) return false;
    task.slot->sync_until_ns.store((now + 2 * under_way + model::kOverdue).count(), kRelaxed);
    set_state(task, abi::TaskState::kSync);
    run.sync.waits = true;
    run.sync.is_counted = !run.on_gpu;
    if (run.sync.is_counted) common_.page().on_gpu.fetch_add(1, kRelaxed);
    common_.governor.company().note(now);
    common_.governor.tasks().changed();
    bump(task.counters.implicit_syncs);
    return true;
}

void ImplicitSyncs::leave(TaskState& task) {
    sched::GovernedRun& run = task.run;
    if (task.taking.load_parks.load(kRelaxed) && task.taking.load_parks.exchange(false))
        common_.gate_keeper.unpark();
    if (!run.sync.waits) return;
    run.sync.waits = false;
    run.pace.no_gap();
    set_state(task, run.on_gpu ? abi::TaskState::kGpu : abi::TaskState::kCpu);
    if (!common_.governor.company().is_alone())
        common_.governor.company().note(common_.clock.now());
    if (run.sync.is_counted) common_.page().on_gpu.fetch_sub(1, kRelaxed);
    common_.governor.tasks().changed();
}

// Under lazy loading, which is the default, a kernel's code is loaded at its first launch in the
// process. Whether this one will do so is not asked: the CUDA runtime launches CUkernels, for which
// the driver's question (cuFuncIsLoaded) is not meant. If it does not, the call is over before
// another task is held for it. The launching thread has the task until the launch is over, and ends
// this when it lets go (Runs): so launches of kernels that were seen before pay nothing for it.
void ImplicitSyncs::first_launch_begins(TaskState& task, identity::KnownKernel& kernel) {
    kernel.is_new = false;
    task.run.pace.no_gap();
    const bool has_gates = common_.gate_keeper.are_on();
    if (has_gates && !task.taking.load_parks.exchange(true)) common_.gate_keeper.park();
    if (enter(task) || has_gates) task.taking.sync_end_is_due.store(true);
}

}  // namespace urgengo::runtime
