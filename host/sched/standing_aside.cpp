// SPDX-License-Identifier: Apache-2.0
#include "host/sched/standing_aside.h"

#include <algorithm>

#include "host/base/memory_orders.h"
#include "host/sched/demand.h"
#include "host/sched/run_ahead.h"

namespace urgengo::sched {
namespace {

/// Periods without a frame, after which a chain is not at work.
constexpr int kGonePeriods = 2;

bool may_stand_aside(const config::Scheduler& s) {
    return s.policy == config::Policy::kFeasible && s.admission == config::Admission::kPacked &&
           s.progress.tracking == config::Tracking::kProgress && !s.progress.learn &&
           s.dispatch.where == config::Dispatch::kThread;
}

bool is_at_work(const GovernedChain& chain, nanoseconds now) {
    const nanoseconds last(chain.last_arrival_ns.load(kRelaxed));
    return last.count() != 0 && now <= last + kGonePeriods * chain.longest();
}

}  // namespace

StandingAside::StandingAside(const config::Scheduler& scheduler, const Tasks& tasks)
    : may_be_(may_stand_aside(scheduler)), tasks_(tasks) {}

bool StandingAside::is_crowded(nanoseconds now) const {
    double launching = 0, gpu = 0, gpu_bound = 0;
    for (const GovernedTask* task : tasks_.all()) {
        if (!is_at_work(*task->chain, now)) continue;
        const auto verdict = static_cast<model::Launching>(task->slot->launching.load(kRelaxed));
        if (verdict == model::Launching::kSlowed) return false;
        const Demand demand = demand_of(*task);
        gpu += demand.shared;
        if (!is_launch_bound(*task)) gpu_bound += demand.shared;
        if (task->is_crowded.load(kRelaxed)) launching += std::min(demand.gpu_and_launching, 1.0);
    }
    return launching >= kCrowd && gpu < kMostLoad && gpu_bound < kMostGpuBound;
}

void StandingAside::look(bool bystanders_are_busy, nanoseconds now) {
    const bool is_crowded = !bystanders_are_busy && this->is_crowded(now);
    const bool was_on = is_on_.load(kRelaxed);
    const int crowded = is_crowded && !was_on ? crowded_.load(kRelaxed) + 1 : 0;
    crowded_.store(crowded, kRelaxed);
    if (crowded >= kLooks) until_.store(now + kAside, kRelaxed);
    is_on_.store(was_on ? is_crowded && now < until_.load(kRelaxed) : crowded >= kLooks, kRelaxed);
}

}  // namespace urgengo::sched
