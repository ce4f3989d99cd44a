// SPDX-License-Identifier: Apache-2.0
//
// Launches that went unasked (planned_launches.cpp) get into the task's record: the thread that
// takes the task next moves the tracker, the counts and the log on by their number.
#include <algorithm>

#include "host/runtime/gpu_segments.h"

#include "host/base/memory_orders.h"

namespace urgengo::runtime {
namespace {

struct PlannedLaunch {
    nanoseconds gpu_time = kUnknownKernel;
    std::uint64_t kernel = 0;
};

PlannedLaunch planned_at(const model::TaskPlan& plan, std::size_t position) {
    if (plan.is_empty()) return {};
    // A helper that came in between may have moved the tracker to the plan's end.
    const auto& kernel = plan.at(std::min(position, plan.num_kernels() - 1));
    return {kernel.gpu_time, kernel.id()};
}

}  // namespace

// When each of them went is not known: some time after the last launch that was asked about, and
// before now. If the program launches steadily, evenly.
/// @param at  position in the plan of the first of the task's last `launches`
void GpuSegments::log_as_planned(TaskState& task, std::size_t at, std::uint32_t launches,
                                 nanoseconds now) {
    nanoseconds time = task.log.time(task.log.count() - 1);
    const nanoseconds between = (now - time) / launches;
    model::LoggedLaunch launch{.time = time,
                               .position = task.run.position - launches,
                               .instance = instance_tag(*task.slot)};
    for (std::uint32_t i = 0; i < launches; ++i, ++at, ++launch.position) {
        const PlannedLaunch planned = planned_at(task.plan, at);
        launch.kernel = planned.kernel;
        launch.time = time += between;
        task.log.launched(planned.gpu_time, launch);
    }
}

// Logs two entries: the last launch, and one that stands for all before it. No task asks any more
// where among them the GPU is.
/// @param total  GPU time of them all
void GpuSegments::log_executed(TaskState& task, std::size_t at, std::uint32_t launches,
                               nanoseconds total, nanoseconds now) {
    const bool is_planned = task.plan.is_empty() || at + launches <= task.plan.num_kernels();
    if (launches < 3 || !is_planned) return log_as_planned(task, at, launches, now);
    const PlannedLaunch before_last = planned_at(task.plan, at + launches - 2);
    const PlannedLaunch last = planned_at(task.plan, at + launches - 1);
    model::LoggedLaunch launch{.time = task.log.time(task.log.count() - 1),  // the first of them
                               .kernel = before_last.kernel,
                               .position = task.run.position - 2,
                               .instance = instance_tag(*task.slot)};
    task.log.launched(total - last.gpu_time, launch);
    launch.time = now;
    launch.kernel = last.kernel;
    ++launch.position;
    task.log.launched(last.gpu_time, launch);
}

// Of a run that is not scheduled: what it has launched is in no estimate.
void GpuSegments::catch_up_observed(TaskState& task, std::uint32_t launches) {
    task.tracker.advance(launches);
    task.run.position += launches;
    bump(task.counters.launches, std::uint64_t{launches});
    bump(task.unasked.observed, launches);
    task.unasked.counted.store(task.unasked.counted.load(kRelaxed) + launches, kRelaxed);
}

// The caller has taken the task.
void GpuSegments::catch_up(TaskState& task, bool executed) {
    const std::uint32_t launches = task.unasked.uncounted(*task.slot);
    if (launches == 0) return;
    if (task.run.observed) return catch_up_observed(task, launches);
    task.run.pace.no_gap();
    const nanoseconds now = common_.clock.now();
    const std::size_t at = task.tracker.position();
    task.tracker.advance(launches);
    const nanoseconds total =
        task.plan.is_empty()
            ? launches * kUnknownKernel
            : task.plan.remaining_from(at) - task.plan.remaining_from(task.tracker.position());
    task.work.launched += total;
    task.run.position += launches;
    bump(task.counters.launches, std::uint64_t{launches});
    bump(task.counters.scheduled, std::uint64_t{launches});
    if (!executed && task.record.is_slow && all_marks_seen(task) &&
        common_.governor.company().is_alone())
        executed = launches_slowly(task, now);
    if (executed)
        log_executed(task, at, launches, total, now);
    else
        log_as_planned(task, at, launches, now);
    task.unasked.counted.store(task.unasked.counted.load(kRelaxed) + launches, kRelaxed);
}

}  // namespace urgengo::runtime
