// SPDX-License-Identifier: Apache-2.0
#include "host/sched/gpu_segment.h"

#include "host/base/memory_orders.h"
#include "host/sched/instance_slot.h"

namespace urgengo::sched {

void enter_gpu_segment(Governor& governor, GovernedTask& task, const BeforeSegment& before,
                       nanoseconds now) {
    GovernedRun& run = task.run;
    abi::TaskSlot& slot = *task.slot;
    run.position_at_mark[slot.marks_issued.load(kRelaxed) % abi::kMarkRing] = run.position;
    // What the CPU did before it: as it passed, waits for a core included.
    if (before.cpu_begin.count() > 0) {
        const nanoseconds took = now - before.cpu_begin;
        task.record.cpu_jitter.saw(took - task.record.cpu.estimate(before.cpu_segment),
                                   kShareOfDelay);
        task.record.cpu.observe(before.cpu_segment, took);
    }
    if (task.stage == 0) task.chain->expectation.launched(before.arrival, now);
    run.pace.no_gap();
    run.mark.at = now;
    run.mark.waited = run.waited.paced + run.waited.held;
    slot.look_ns.store(now.count(), kRelaxed);
    slot.progress_ns.store(now.count(), kRelaxed);
    slot.started.store(0, kRelaxed);
    set_state(task, abi::TaskState::kGpu);
    governor.comes_to_gpu(task, now);
    run.on_gpu = true;
    governor.estimates().segment_begins(task, before.position, now);
}

void measure_gpu_segment(Governor& governor, GovernedTask& task, bool is_idle, std::size_t position,
                         nanoseconds now) {
    if (!is_idle) {
        task.run.estimate.is_measured = false;
        return;
    }
    governor.look_for_bystanders(now);
    governor.estimates().segment_ended(task, position, governor.bystanders().are_there(), now);
}

void all_executed(GovernedTask& task) {
    abi::TaskSlot& slot = *task.slot;
    const std::uint32_t issued = slot.marks_issued.load(kRelaxed);
    slot.launched_at_mark_ns[issued % abi::kMarkRing].store(task.work.launched.count(), kRelaxed);
    task.run.position_at_mark[issued % abi::kMarkRing] = task.run.position;
    task.fork_is_over();
    // Executed, too, also where the thread that asks for events has yet to see it.
    slot.marks_done.store(issued, kRelaxed);
    task.work.marks_all();
}

}  // namespace urgengo::sched
