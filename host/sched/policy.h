// SPDX-License-Identifier: Apache-2.0
//
// The policies by name. How to add one: CONTRIBUTING.md.
#pragma once

#include "host/config/config.h"
#include "host/sched/policies/edf.h"
#include "host/sched/policies/eqdf.h"
#include "host/sched/policies/feasible.h"
#include "host/sched/policies/fifo.h"
#include "host/sched/policies/hrrn.h"
#include "host/sched/policies/lcuf.h"
#include "host/sched/policies/saedf.h"
#include "host/sched/policies/sjf.h"
#include "host/sched/policies/static_order.h"
#include "host/sched/policies/urgency.h"
#include "host/sched/policies/utilization.h"

namespace urgengo::sched {

/// The policy's own key, demoted or not. Host and GPU alike.
constexpr Key policy_key(config::Policy policy, const Standing& standing, const SlotView& v) {
    using config::Policy;
    switch (policy) {
        case Policy::kFeasible:
            return feasible_key(v, standing);
        case Policy::kUrgency:
            return urgency_key(v);
        case Policy::kEdf:
            return edf_key(v);
        case Policy::kEqdf:
            return eqdf_key(v, standing.lambda);
        case Policy::kSaedf:
            return saedf_key(v, standing.lambda);
        case Policy::kLcuf:
            return lcuf_key(v);
        case Policy::kSjf:
            return sjf_key(v);
        case Policy::kHrrn:
            return hrrn_key(v, standing.now);
        case Policy::kStatic:
            return static_key(v);
        case Policy::kFifo:
            return fifo_key(v);
        case Policy::kUtilization:
            return utilization_key(v);
    }
    return feasible_key(v, standing);
}

/// The same with what comes before any policy.
constexpr Key key_of(config::Policy policy, const Standing& standing, const SlotView& v) {
    if (v.state.demoted) return kDemoted;
    if (v.state.starved) return kStarved + v.deadline.count();
    return policy_key(policy, standing, v);
}

/// The order of a snapshot's tasks, for launches and for copies. Each key is asked for once, so
/// none is kept: there may be hundreds, and the stack is the program's.
class Order {
  public:
    Order(const config::Scheduler& scheduler, const Snapshot& snapshot)
        : scheduler_(scheduler), snapshot_(snapshot), own_(key_of(snapshot.self())) {}
    /// @returns the key of the asking task
    Key own() const { return own_; }
    /// @param other  place in the snapshot, from 1 on
    /// @returns whether that task comes before the asking one
    bool is_before_self(std::size_t other) const {
        const SlotView& v = snapshot_.tasks[other];
        const Key key = key_of(v);
        return key < own_ || (key == own_ && v.task < snapshot_.self().task);
    }

    /// @param both  places in the snapshot
    bool is_before(std::size_t one, std::size_t other) const {
        const SlotView& a = snapshot_.tasks[one];
        const SlotView& b = snapshot_.tasks[other];
        const Key key_a = key_of(a), key_b = key_of(b);
        return key_a < key_b || (key_a == key_b && a.task < b.task);
    }

  private:
    Key key_of(const SlotView& v) const {
        const Plan& plan = snapshot_.plan;
        return sched::key_of(scheduler_.policy,
                             {snapshot_.now, scheduler_.parameters.lambda,
                              plan.given_up.contains(v.task), plan.late_first.contains(v.task)},
                             v);
    }

    const config::Scheduler& scheduler_;
    const Snapshot& snapshot_;
    const Key own_;
};

}  // namespace urgengo::sched
