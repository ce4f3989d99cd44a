// SPDX-License-Identifier: Apache-2.0
#include "host/sched/run_ahead.h"

#include <algorithm>

#include "host/base/memory_orders.h"

namespace urgengo::sched {
namespace {

/// Of a launch-bound task, in run_ahead.
constexpr int kLaunchBoundAhead = 4;

}  // namespace

bool is_launch_bound(const GovernedTask& task) {
    return 2 * task.estimated.idle_ns.load(kRelaxed) > task.estimated.gpu_ns.load(kRelaxed);
}

bool is_paced(const GovernedTask& task, nanoseconds now) {
    return task.run.pace.is_bounded || now - task.run.pace.looked_at >= model::kLaunchGrace;
}

nanoseconds RunAhead::bound(const GovernedTask& task, nanoseconds now) const {
    const bool more = company_.is_alone() && (task.record.is_slow || task.run.mark.was_slow);
    const int times = more ? 2 : is_launch_bound(task) ? kLaunchBoundAhead : 1;
    const nanoseconds limit = scheduler_.run_ahead.limit;
    const nanoseconds usual = std::max(times * limit, limit + task.record.gaps.lateness(now));
    return task.planned(lead_.leads(task, now) ? std::max(usual, scheduler_.run_ahead.alone)
                                               : usual);
}

}  // namespace urgengo::sched
