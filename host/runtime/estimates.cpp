// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/estimates.h"

#include <algorithm>

#include "host/base/memory_orders.h"
#include "host/sched/instance_slot.h"

namespace urgengo::runtime {
void instance_measured(Common& common, TaskState& task) {
    const auto contradicts = common.governor.estimates().instance_ended(task, common.clock.now());
    if (!contradicts) return;
    common.guard.estimates_contradict(task.chain->index, *contradicts);
    note_launching(task);
}

void note_launching(const TaskState& task) {
    if (task.stage != 0) return;
    observe::ChainStatistics& s = task.its_chain().statistics;
    s.launching.state.store(model::to_string(task.record.contention.verdict()), kRelaxed);
    s.launching.pace.store(task.record.contention.pace(), kRelaxed);
    s.launching.slowdown.store(task.record.contention.slowdown(), kRelaxed);
    s.launching.together.store(task.record.contention.together(), kRelaxed);
}

void publish_head(TaskState& task) {
    sched::publish_head(task, still_to_launch(task), still_idle(task));
}

model::KernelEstimate unknown_kernel(const TaskState& task, const Launch& launch) {
    const double threads = static_cast<double>(launch.grid_blocks) * launch.block_threads;
    return {kUnknownKernel, std::min(1.0, threads / task.tracked.marks->resident_threads)};
}

}  // namespace urgengo::runtime
