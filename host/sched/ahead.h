// SPDX-License-Identifier: Apache-2.0
//
// How far a task may be ahead of the GPU, and how often that is seen: one rule a file.
#pragma once

#include "host/sched/lead.h"
#include "host/sched/mark_spacing.h"
#include "host/sched/run_ahead.h"

namespace urgengo::sched {

struct Ahead {
    /// All outlive it.
    Ahead(const config::Scheduler& scheduler, Tasks& tasks, const Company& company)
        : lead(scheduler, tasks, company),
          run_ahead(scheduler, company, lead),
          mark_spacing(scheduler, company, lead) {}

    Lead lead;
    RunAhead run_ahead;
    MarkSpacing mark_spacing;
};

}  // namespace urgengo::sched
