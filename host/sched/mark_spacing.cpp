// SPDX-License-Identifier: Apache-2.0
#include "host/sched/mark_spacing.h"

#include <algorithm>

#include "host/sched/run_ahead.h"

namespace urgengo::sched {
namespace {

/// From one mark of a task alone to the next, at most.
constexpr nanoseconds kFarthest{1'000'000};
constexpr nanoseconds kCrowdedEvery{100'000};

}  // namespace

nanoseconds MarkSpacing::between(const GovernedTask& task, nanoseconds every,
                                 nanoseconds now) const {
    // Behind every launch means that, and never where nothing was launched.
    const bool marks_all = scheduler_.progress.mark_every == nanoseconds{0};
    every = std::max(every, nanoseconds{1});
    if (const std::uint32_t crowd = under_way(*task.slot); crowd >= kManyMarks)
        return task.planned(std::max(every, kCrowdedEvery) *
                            (1 << (crowd - kManyMarks) / kDoubleAfter));
    if (marks_all || !company_.is_alone() || scheduler_.progress.learn) return task.planned(every);
    const nanoseconds most = std::min(scheduler_.run_ahead.limit, kFarthest);
    if (task.record.is_slow) return task.planned(std::max(every, most));
    if (lead_.leads(task, now))
        return task.planned(std::max(every, std::min({scheduler_.run_ahead.alone / 2, 2 * kFarthest,
                                                      kLongUnit * scheduler_.run_ahead.limit})));
    return task.planned(
        std::max(every, company_.no_other_looks(now) ? most / 2 : std::min(2 * every, most / 2)));
}

bool MarkSpacing::is_spared(const GovernedTask& task, bool is_scarce) const {
    const config::ProgressSettings& progress = scheduler_.progress;
    const bool may_be = progress.tracking == config::Tracking::kProgress && !progress.learn &&
                        progress.mark_every != nanoseconds{0};
    return is_scarce && may_be && is_launch_bound(task) && !company_.is_alone() &&
           task.work.launched - task.work.marked < task.planned(kFarthest);
}

}  // namespace urgengo::sched
