// SPDX-License-Identifier: Apache-2.0
#include "host/progress/learning.h"

#include <chrono>
#include <vector>

namespace urgengo::progress {
namespace {

using std::chrono::nanoseconds;

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

Learning::Learning(const model::TaskPlan& plan) : durations_(planned_times(plan)) {}

void Learning::segment_begins(const Others& others) {
    if (left_idle_) others_ = others;
}

std::optional<model::ExecutedMark> Learning::new_mark(const ug_mark_line& line,
                                                      std::uint32_t issued) const {
    if (line.clock != UG_MARK_CLOCK_GPU) return std::nullopt;
    const auto mark = model::read_mark(line, issued);
    if (!mark || mark->stamp == UG_MARK_NO_TIME) return std::nullopt;
    const auto ahead = static_cast<std::int32_t>(mark->sequence - last_.sequence);
    return is_known_ && ahead <= 0 ? std::nullopt : mark;
}

void Learning::learn(const model::ExecutedMark& mark, const model::GpuClock& clock,
                     const model::LaunchLog& log, bool overlaps, const Others& others) {
    const auto host = clock.to_host(mark.stamp);
    if (!host) return;
    const model::StampedMark seen{mark.sequence, mark.stamp, host->time, host->error};
    if (is_known_) {
        const bool shared =
            others_.are_there || others.are_there || others.changes != others_.changes;
        const nanoseconds mark_cost = overlaps ? kProgrammaticMarkCost : kPlainMarkCost;
        if (const auto span = model::span_between(log, last_, seen, mark_cost, shared))
            durations_.observe(log, *span);
    }
    last_ = seen;
    is_known_ = true;
    others_ = others;
}

}  // namespace urgengo::progress
