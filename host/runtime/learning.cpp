// SPDX-License-Identifier: Apache-2.0
//
// How long a task's kernels take, learned from its marks while it runs (`progress: {learn: on}`):
// what lies between two marks that were seen executed goes to model/durations.h. By whoever has the
// task, whenever it looks at its own progress, marks it, or leaves the GPU.
//
// Only marks with a time of the GPU tell: mark kernels.
#include <algorithm>

#include "host/runtime/runtime.h"

namespace urgengo::runtime {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;

/// GPU time of a mark kernel, launched plainly and with programmatic stream serialisation. (Chain
/// of 400 kernels, H200, 2026-11-21; on a host farther from its GPU 2.5 and 1.7 us were seen.)
constexpr nanoseconds kPlainMarkCost{1'700};
constexpr nanoseconds kProgrammaticMarkCost{830};

std::vector<model::Durations::Planned> planned_times(const model::TaskPlan& plan) {
    std::vector<model::Durations::Planned> times;
    for (std::size_t i = 0; i < plan.num_kernels(); ++i)
        times.push_back({plan.at(i).id(), plan.at(i).gpu_time});
    return times;
}

}  // namespace

Learning::Learning(const model::TaskPlan& plan) : durations(planned_times(plan)) {}

void Runtime::learn(TaskState& task) {
    Learning& learning = *task.learning;
    const ug_mark_line* line = task.line.load(kRelaxed);
    if (!line || !task.tracked.marks || line->clock != UG_MARK_CLOCK_GPU) return;
    const auto mark = model::read_mark(*line, task.slot->marks_issued.load(kRelaxed));
    if (!mark || mark->stamp == UG_MARK_NO_TIME) return;
    const auto ahead = static_cast<std::int32_t>(mark->sequence - learning.last.sequence);
    if (learning.is_known && ahead <= 0) return;
    // Nobody else may have seen it yet.
    governor_.tasks().look(task, clock_.now());
    const auto host = gpu_clock_.to_host(mark->stamp);
    if (!host) return;
    const model::StampedMark seen{mark->sequence, mark->stamp, host->time, host->error};
    const std::uint32_t changes = page_->changes.load(kRelaxed);
    const bool is_shared = !governor_.company().is_alone();
    const nanoseconds mark_cost =
        task.tracked.marks->overlaps.load(kRelaxed) ? kProgrammaticMarkCost : kPlainMarkCost;
    if (learning.is_known) {
        const bool shared = learning.shared || is_shared || changes != learning.changes;
        if (const auto span = model::span_between(task.log, learning.last, seen, mark_cost, shared))
            learning.durations.observe(task.log, *span);
    }
    learning.last = seen;
    learning.is_known = true;
    learning.changes = changes;
    learning.shared = is_shared;
}

}  // namespace urgengo::runtime
