// SPDX-License-Identifier: Apache-2.0
//
// The lead: a solitary task may be further ahead of the GPU than others (company.h, 3).
//
// 1 A program that launches long kernels first needs its lead for the short ones behind them: it is
//   no faster than the GPU, so the time for which it is paced is lost (342 launches in 4 ms of CPU
//   and GPU time alike: 25 % more; simulated GPU). An arriving task overtakes a lead, which is
//   launched at a lower priority, but kernel by kernel: a first frame of ten kernels beside others
//   of 0.2 ms took 2.9 ms instead of 2.0. So no task leads where another chain's frame may come.
// 2 It leads only where its launches can be below those of an arriving task that is more urgent: of
//   two levels the other one is that of all launches without a priority of their own.
// 3 A lead is launched half-way down the levels: an arriving task may have to lead as well (4). It
//   is below the leads of more urgent tasks that are under way, and above those of less urgent
//   ones, and leaves a level free on either side where it can: what comes may belong in between.
//   All other launches are below the leads of more urgent tasks until the GPU has got through
//   these, and above those of less urgent ones.
// 4 A fork over several streams may be far ahead, as no mark shows how far it is: at once where it
//   is not followed (model/fork_progress.h), or goes for the sake of an awaited task. So it is
//   taken for a lead from where it would be paced: else an arriving task had to wait for all of it.
//   (With its rank's priority instead, forks that are followed missed more: 37 random workloads
//   over several streams 2.2 % with a profile and 3.6 without one, not 2.0 and 2.1; simulated GPU.)
// 5 A task leads as well that goes farther ahead for the sake of an awaited one (lending.h, 3).
//
// @threads any; a race costs a level of one launch
#pragma once

#include <cstdint>

#include "host/config/config.h"
#include "host/model/task_set.h"
#include "host/sched/company.h"
#include "host/sched/tasks.h"

namespace urgengo::sched {

/// How far ahead of the GPU a launch goes.
enum class Reach : std::uint8_t {
    kWithinLead,  ///< no farther than a lead may, or in a fork
    kBeyondLead,  ///< farther, where it can have a lead's priority
    kTooFar,      ///< where it cannot, or so much is launched that the driver may block
};

/// Of priority, counted from the greatest.
struct Levels {
    int first = 0;  ///< the greatest that a launch may have, whatever the program wishes
    int level = 0;  ///< that it has without a wish
};

class Lead {
  public:
    /// @param all of them  outlive it
    Lead(const config::Scheduler& scheduler, const Tasks& tasks, const Company& company)
        : scheduler_(scheduler), tasks_(tasks), company_(company) {}

    /// @returns whether the task may be further ahead of the GPU
    bool leads(const GovernedTask& task, nanoseconds now) const;
    /// @returns whether there are priorities enough for it to have one
    bool has_levels(const GovernedTask& task) const;
    /// Of a launch that goes now.
    /// @param is_vouched  marks show how far the task is
    /// @param wanted      the level that it would have, of so many
    /// @param beside_bystanders  the last level is that of most programs' streams, and of
    ///                           bystanders
    Levels levels(GovernedTask& task, bool is_vouched, const Decision& decision, int wanted,
                  int num_levels, bool beside_bystanders, nanoseconds now);
    /// All that the task has launched has executed, or will without being seen.
    void over(GovernedTask& task) {
        if (task.lead.level.load(kRelaxed) == 0) return;
        task.lead.level.store(0, kRelaxed);
        leaders_.erase(task.index);
    }

  private:
    static constexpr auto kRelaxed = std::memory_order_relaxed;
    bool forks_ahead(const GovernedTask& task, bool is_vouched) const;
    bool is_under_way(const GovernedTask& leader) const;

    const config::Scheduler& scheduler_;
    const Tasks& tasks_;
    const Company& company_;
    model::SharedTaskSet leaders_;  ///< tasks that have a lead, or had one
};

}  // namespace urgengo::sched
