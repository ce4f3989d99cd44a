// SPDX-License-Identifier: Apache-2.0
//
// The policies by name. A new one: a file in policies/, an enumerator in config.h, a case here.
#pragma once

#include "host/config/config.h"
#include "host/sched/policies/edf.h"
#include "host/sched/policies/feasible.h"
#include "host/sched/policies/urgency.h"

namespace urgengo::sched {

/// @param[out] keys  shape [snapshot.tasks.size()]
inline void policy_keys(config::Policy policy, const Snapshot& snapshot, std::span<Key> keys) {
    const auto one_by_one = [&](auto key_of) {
        for (std::size_t i = 0; i < keys.size(); ++i) keys[i] = key_of(snapshot.tasks[i]);
    };
    switch (policy) {
        case config::Policy::kUrgency:
            return one_by_one(urgency_key);
        case config::Policy::kEdf:
            return one_by_one(edf_key);
        case config::Policy::kFeasible:
            return feasible_keys(snapshot, keys);
    }
}

}  // namespace urgengo::sched
