// SPDX-License-Identifier: Apache-2.0
//
// The policies by name. A new one: a file in policies/, an enumerator in config.h with its word in
// names.h, a case here.
#pragma once

#include <array>

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

/// The policy's own keys, whoever is demoted.
/// @param[out] keys  shape [snapshot.tasks.size()]
inline void policy_keys(const config::Scheduler& scheduler, const Snapshot& snapshot,
                        std::span<Key> keys) {
    using config::Policy;
    const auto one_by_one = [&](auto key_of) {
        for (std::size_t i = 0; i < keys.size(); ++i) keys[i] = key_of(snapshot.tasks[i]);
    };
    switch (scheduler.policy) {
        case Policy::kFeasible:
            return one_by_one([&](const auto& v) { return feasible_key(v, snapshot); });
        case Policy::kUrgency:
            return one_by_one(urgency_key);
        case Policy::kEdf:
            return one_by_one(edf_key);
        case Policy::kEqdf:
            return one_by_one([&](const auto& v) { return eqdf_key(v, scheduler.lambda); });
        case Policy::kSaedf:
            return one_by_one([&](const auto& v) { return saedf_key(v, scheduler.lambda); });
        case Policy::kLcuf:
            return one_by_one(lcuf_key);
        case Policy::kSjf:
            return one_by_one(sjf_key);
        case Policy::kHrrn:
            return one_by_one([&](const auto& v) { return hrrn_key(v, snapshot.now); });
        case Policy::kStatic:
            return one_by_one(static_key);
        case Policy::kFifo:
            return one_by_one(fifo_key);
        case Policy::kUtilization:
            return one_by_one(utilization_key);
    }
}

/// The order of a snapshot's tasks, for launches and for copies.
class Order {
  public:
    Order(const config::Scheduler& scheduler, const Snapshot& snapshot) : snapshot_(snapshot) {
        const std::span<Key> keys(keys_.data(), snapshot.tasks.size());
        policy_keys(scheduler, snapshot, keys);
        for (std::size_t i = 0; i < keys.size(); ++i) {
            const SlotView& v = snapshot.tasks[i];
            if (v.starved) keys[i] = kStarved + v.deadline.count();
            if (v.demoted) keys[i] = kDemoted;
        }
    }
    /// @param other  place in the snapshot, from 1 on
    /// @returns whether that one comes before the one that asks
    bool is_before_self(std::size_t other) const {
        return keys_[other] < keys_[0] ||
               (keys_[other] == keys_[0] && snapshot_.tasks[other].task < snapshot_.self().task);
    }

  private:
    const Snapshot& snapshot_;
    std::array<Key, abi::kMaxTasks> keys_;
};

}  // namespace urgengo::sched
