// SPDX-License-Identifier: Apache-2.0
//
// The Governor: all that decides, over the slots of the active kernel buffer and the tasks' records
// (governed.h). It is told what happens, and asked what may be done. It knows no CUDA, no clock, no
// thread and no lock; time is an argument.
//
// One thread at a time is at a task: what is told or asked about that task, is by that thread. What
// is of all tasks are atomics of the part that they belong to; a race costs one decision of
// microseconds.
#pragma once

#include <vector>

#include "host/config/config.h"
#include "host/sched/company.h"
#include "host/sched/lead.h"
#include "host/sched/run_ahead.h"
#include "host/sched/standing_plan.h"
#include "host/sched/tasks.h"

namespace urgengo::sched {

class Governor {
  public:
    /// @param page, listener  outlive it
    /// @param start  now
    Governor(const config::Scheduler& scheduler, const std::vector<config::Chain>& chains,
             abi::SharedPage& page, ProgressListener& listener, nanoseconds start)
        : scheduler_(scheduler),
          tasks_(scheduler_, page, listener),
          company_(page, chains, start),
          lead_(scheduler_, tasks_, company_),
          run_ahead_(scheduler_, company_, lead_),
          plan_(scheduler_, tasks_, most_instances(chains)) {}

    Tasks& tasks() { return tasks_; }
    const Tasks& tasks() const { return tasks_; }
    Company& company() { return company_; }
    const Company& company() const { return company_; }
    Lead& lead() { return lead_; }
    const Lead& lead() const { return lead_; }
    const RunAhead& run_ahead() const { return run_ahead_; }
    StandingPlan& plan() { return plan_; }
    const StandingPlan& plan() const { return plan_; }

  private:
    /// One a task, and each chain's next one.
    static std::size_t most_instances(const std::vector<config::Chain>& chains) {
        std::size_t most = chains.size();
        for (const config::Chain& chain : chains) most += chain.tasks.size();
        return most;
    }

    const config::Scheduler scheduler_;
    Tasks tasks_;
    Company company_;
    Lead lead_;
    RunAhead run_ahead_;
    StandingPlan plan_;
};

}  // namespace urgengo::sched
