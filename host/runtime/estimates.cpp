// SPDX-License-Identifier: Apache-2.0
//
// What sched/estimates.h is told of a task, and what the guard and the statistics are told of it.
#include "host/runtime/runtime.h"
#include "host/sched/instance_slot.h"

namespace urgengo::runtime {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;

}  // namespace

/// The instance has ended.
void Runtime::instance_measured(TaskState& task) {
    const auto contradicts = common_.governor.estimates().instance_ended(task, common_.clock.now());
    if (!contradicts) return;
    common_.guard.estimates_contradict(task.chain->index, *contradicts);
    note_launching(task);
}

/// Into its chain's statistics.
void Runtime::note_launching(const TaskState& task) {
    if (task.stage != 0) return;
    observe::ChainStatistics& s = task.its_chain().statistics;
    s.launching.store(model::to_string(task.contention.verdict()), kRelaxed);
    s.launch_pace.store(task.contention.pace(), kRelaxed);
    s.slowdown.store(task.contention.slowdown(), kRelaxed);
}

/// What the task has not launched yet.
void Runtime::publish_head(TaskState& task) {
    sched::publish_head(task, still_to_launch(task), still_idle(task));
}

}  // namespace urgengo::runtime
