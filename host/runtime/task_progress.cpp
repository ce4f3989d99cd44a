// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/task_progress.h"

#include "host/base/memory_orders.h"

namespace urgengo::runtime {
namespace {

progress::FollowedTask followed(TaskState& task) {
    return {.slot = *task.slot,
            .line = task.line,
            .pending_ns = task.pending_ns,
            .planned_from = task.unasked.from,
            .log = task.log,
            .pace = task.pace,
            .plan = task.plan};
}

}  // namespace

// How much that is, the log says, if it still has the mark.
void TaskProgress::note_executed(TaskState& task, const progress::Positions::Seen& seen) {
    if (!seen.time) return;
    const std::uint32_t mark = seen.mark.sequence;
    const std::uint32_t launches = task.log.launches_before_mark(mark);
    const nanoseconds work = task.log.end(launches - 1);
    if (task.log.still_holds(launches - 1, mark)) task.facts.executed.add(mark, {*seen.time, work});
}

void TaskProgress::progressed(sched::GovernedTask& task, const sched::SlotView& view,
                              const ug_mark_line& line, nanoseconds pending) {
    auto& its = static_cast<TaskState&>(task);
    const auto seen =
        positions_.saw_mark(followed(its), line, pending, !governor_.company().is_alone());
    if (seen) note_executed(its, *seen);
    if (seen) records_.mark_seen(its, *seen, view.laxity, positions_.gpu_clock(), clock_);
    if (shown_to_) shown_to_->progressed(task, line);
}

std::optional<progress::TaskPosition> TaskProgress::position(std::string_view chain,
                                                             std::string_view name) {
    const ChainState* const its_chain = roster_.find_chain(chain);
    TaskState* const task = its_chain ? roster_.find_task(*its_chain, name) : nullptr;
    if (!task) return std::nullopt;
    return positions_.locate(followed(*task), !governor_.company().is_alone(), clock_.now());
}

progress::Learning::Others TaskProgress::others() const {
    return {page_.changes.load(kRelaxed), !governor_.company().is_alone()};
}

void TaskProgress::learn(TaskState& task) {
    progress::Learning& learning = *task.learning;
    const ug_mark_line* line = task.line.load(kRelaxed);
    if (!line || !task.tracked.marks) return;
    const auto mark = learning.new_mark(*line, task.slot->marks_issued.load(kRelaxed));
    if (!mark) return;
    // No other thread may have seen it yet.
    governor_.tasks().look(task, clock_.now());
    learning.learn(*mark, positions_.gpu_clock(), task.log,
                   task.tracked.marks->overlaps.load(kRelaxed), others());
}

}  // namespace urgengo::runtime
