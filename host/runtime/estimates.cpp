// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/estimates.h"

#include <algorithm>

#include "host/sched/instance_slot.h"

namespace urgengo::runtime {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;

}  // namespace

void instance_measured(Common& common, TaskState& task) {
    const auto contradicts = common.governor.estimates().instance_ended(task, common.clock.now());
    if (!contradicts) return;
    common.guard.estimates_contradict(task.chain->index, *contradicts);
    note_launching(task);
}

void note_launching(const TaskState& task) {
    if (task.stage != 0) return;
    observe::ChainStatistics& s = task.its_chain().statistics;
    s.launching.store(model::to_string(task.contention.verdict()), kRelaxed);
    s.launch_pace.store(task.contention.pace(), kRelaxed);
    s.slowdown.store(task.contention.slowdown(), kRelaxed);
}

void publish_head(TaskState& task) {
    sched::publish_head(task, still_to_launch(task), still_idle(task));
}

model::KernelEstimate unknown_kernel(const TaskState& task, const Launch& launch) {
    const double threads = static_cast<double>(launch.grid_blocks) * launch.block_threads;
    return {kUnknownKernel, std::min(1.0, threads / task.tracked.marks->resident_threads)};
}

}  // namespace urgengo::runtime
