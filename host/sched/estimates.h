// SPDX-License-Identifier: Apache-2.0
//
// Estimates prove themselves: what each instance took is compared with what the plan says
// (model/estimate_factor.h), and corrects what is said of the next ones.
//
// 1 A GPU segment is measured from its first launch to the end of the wait for it, less what the
//   program was held for. While it was held and had nothing on the GPU, none of its work was done;
//   while it was paced, or held with work under way, it was.
// 2 An instance that only bystanders shared the GPU with tells how much these slow a task down, and
//   is not taken for one that had the GPU alone. A launch-bound one tells nothing of that.
// 3 A chain may be given up on estimates that its own record supports; each that is given up is
//   tried again after kRetryAfter instances, as it may be met by now.
// 4 What the GPU waits for a task's launches depends on how long it works, and on how slowly others
//   make it launch: both are reckoned anew where they have changed by kReckonBeyond, as that takes
//   time linear in the launches.
//
// @threads the one that has the task
#pragma once

#include <optional>

#include "host/sched/bystanders.h"
#include "host/sched/company.h"
#include "host/sched/standing_plan.h"

namespace urgengo::sched {

class Estimates {
  public:
    /// @param all of them  outlive it
    Estimates(const config::Scheduler& scheduler, const Tasks& tasks, const Company& company,
              Bystanders& bystanders, StandingPlan& plan)
        : scheduler_(scheduler),
          tasks_(tasks),
          company_(company),
          bystanders_(bystanders),
          plan_(plan) {}

    /// The task makes its first launch of a GPU segment. @param position  of that, in the plan
    void segment_begins(GovernedTask& task, std::size_t position, nanoseconds now) const;
    /// Where a mark of the task was launched, or spared: how many others launch.
    void sees_launchers(GovernedTask& task, nanoseconds now) const;
    /// A wait for all that it has launched there has ended. @param position  in the plan, behind it
    /// @param beside_bystanders  whether work of no chain was launched lately
    void segment_ended(GovernedTask& task, std::size_t position, bool beside_bystanders,
                       nanoseconds now) const;
    /// @returns whether what the plan says of the task is far from what was measured; nothing if
    ///          the instance tells nothing
    std::optional<bool> instance_ended(GovernedTask& task, nanoseconds now);
    /// @returns SlotView::longer_beside of a view; 0 without a plan, or if no bystander is busy
    nanoseconds longer_beside(const SlotView& view) const;
    /// A hold has ended during which it waited for its turn to launch.
    /// @param since  it first did
    void waited_for_turn(GovernedTask& task, const Decision& decision, nanoseconds since,
                         nanoseconds now);

  private:
    /// Other tasks that launch.
    struct Launchers {
        int slowed = 0;  ///< those that others' launching slows down, or may
        int free = 0;    ///< the others
    };
    Launchers others_launching(const GovernedTask& task, nanoseconds now) const;
    void publish_speed(GovernedTask& task, nanoseconds now) const;
    bool have_paused_got_on(const GovernedTask& task, const TaskSet& before,
                            nanoseconds since) const;
    void judge_support(GovernedTask& task) const;
    void tell_of_bystanders(GovernedTask& task) const;
    void reckon(GovernedTask& task);
    void publish_launching(GovernedTask& task);

    const config::Scheduler& scheduler_;
    const Tasks& tasks_;
    const Company& company_;
    Bystanders& bystanders_;
    StandingPlan& plan_;
};

}  // namespace urgengo::sched
