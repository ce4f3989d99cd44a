// SPDX-License-Identifier: Apache-2.0
//
// Run-ahead: how much GPU time a task may have launched and not executed. Beyond it the task is
// paced, for the others' sake: what is on the GPU is overtaken kernel by kernel only.
//
// 1 `run_ahead_us`, by the plan's estimates; of a task in a lead `run_ahead_alone_us` (lead.h).
// 2 A launch-bound task, by its plan, has four times that: the GPU waits for such a program, which
//   is hardly ever ahead of it, and must not be made to wait for a mark to tell that (nor, in an
//   interpreter, for the other threads' turns).
// 3 A slow program's launches are few at a time on their way to the GPU. When it turns out to be
//   slow no more, it is marked, and must not wait for that mark before it has had its time. Alone
//   it has twice that.
// 4 Between a fork over several streams and its join marks of single branches tell how far the task
//   is (model/fork_progress.h). It is paced only while a mark is under way.
// 5 What a task is known of is as of its last look: the GPU is further by now. What was overdue at
//   that look is not paced for a moment.
// 6 A task whose launching has gaps, as on busy cores, has as much more as these take
//   (launch_gaps.h), up to four times `run_ahead_us`: the GPU got through 1 ms before its thread
//   had its turn again.
#pragma once

#include <algorithm>

#include "host/config/config.h"
#include "host/sched/lead.h"

namespace urgengo::sched {

/// @returns whether the GPU waits for the task's launches, by its plan
bool is_launch_bound(const GovernedTask& task);
bool is_paced(const GovernedTask& task, nanoseconds now);

class RunAhead {
  public:
    /// @param all of them  outlive it
    RunAhead(const config::Scheduler& scheduler, const Company& company, const Lead& lead)
        : scheduler_(scheduler), company_(company), lead_(lead) {}

    /// @returns the bound, of estimates by the plan
    nanoseconds bound(const GovernedTask& task, nanoseconds now) const;
    bool is_within(const GovernedTask& task, nanoseconds now) const {
        return task.ahead() <= bound(task, now);
    }
    /// Of the launch that would be next.
    Reach reach(const GovernedTask& task, bool is_in_fork) const {
        const nanoseconds most = std::max(scheduler_.run_ahead.limit, scheduler_.run_ahead.alone);
        if (is_in_fork || task.ahead() <= task.planned(most)) return Reach::kWithinLead;
        return lead_.has_levels(task) && task.queued() < kMostQueued ? Reach::kBeyondLead
                                                                     : Reach::kTooFar;
    }

  private:
    /// Launches: of about a thousand on a stream a driver has the next one wait, in its call.
    static constexpr std::uint32_t kMostQueued = 512;

    const config::Scheduler& scheduler_;
    const Company& company_;
    const Lead& lead_;
};

}  // namespace urgengo::sched
