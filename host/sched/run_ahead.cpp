// SPDX-License-Identifier: Apache-2.0
#include "host/sched/run_ahead.h"

#include <algorithm>

namespace urgengo::sched {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
/// Of a launch-bound task, in run_ahead.
constexpr int kLaunchBoundAhead = 4;

}  // namespace

bool is_launch_bound(const GovernedTask& task) {
    return 2 * task.idle_time_ns.load(kRelaxed) > task.gpu_time_ns.load(kRelaxed);
}

bool is_paced(const GovernedTask& task, nanoseconds now) {
    return task.run.is_paced || now - task.run.looked_at >= model::kLaunchGrace;
}

nanoseconds RunAhead::bound(const GovernedTask& task, nanoseconds now) const {
    const bool more = company_.is_alone() && (task.is_slow || task.run.was_slow);
    const int times = more ? 2 : is_launch_bound(task) ? kLaunchBoundAhead : 1;
    const nanoseconds usual = times * scheduler_.run_ahead;
    return task.planned(lead_.leads(task, now) ? std::max(usual, scheduler_.run_ahead_alone)
                                               : usual);
}

}  // namespace urgengo::sched
