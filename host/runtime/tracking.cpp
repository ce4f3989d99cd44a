// SPDX-License-Identifier: Apache-2.0
//
// The paper's ways of tracking (progress/batch_tracking.h) at the launches of tasks.
#include "host/exec/batch_events.h"
#include "host/runtime/gpu_segments.h"

namespace urgengo::runtime {

progress::BatchedTask GpuSegments::batched(TaskState& task) {
    return {.batches = task.batches,
            .slot = *task.slot,
            .line = task.tracked.marks->lines[task.index],
            .log = task.log,
            .position_at_mark = task.run.position_at_mark,
            .marked = task.work.marked,
            .launched = task.work.launched,
            .position = task.run.position};
}

void GpuSegments::end_batch(TaskState& task) {
    exec::BatchEvents ends(common_.driver, common_.governor, task, task.batches.events,
                           task.tracked.marks, task.tracked.stream, task.tracked.flavor);
    heed(task, batches_.end_batch(batched(task), ends, common_.governor.hold_bound(task)));
}

// The stream of the last launch does not matter here: nothing is recorded.
bool GpuSegments::wait_for_batches(TaskState& task, std::uint32_t still_open) {
    if (!batches_.must_wait(batched(task), still_open) ||
        common_.marks.prepare() != task.tracked.marks)
        return false;
    task.run.pace.no_gap();
    exec::BatchEvents ends(common_.driver, common_.governor, task, task.batches.events,
                           task.tracked.marks, task.tracked.stream, task.tracked.flavor);
    heed(task, batches_.wait(batched(task), still_open, ends, common_.governor.hold_bound(task)));
    return true;
}

void GpuSegments::heed(TaskState& task, progress::BatchTracking::Outcome outcome) {
    using Outcome = progress::BatchTracking::Outcome;
    if (outcome == Outcome::kRefused) refuse_marks(task);
    if (outcome == Outcome::kWaitedInVain) bump(task.counters.holds_opened);
}

}  // namespace urgengo::runtime
