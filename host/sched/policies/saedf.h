// SPDX-License-Identifier: Apache-2.0
//
// saedf: suspension-aware earliest deadline first: smallest t_arr + D + lambda * S, where S is how
// long the chain suspends its CPU: its GPU time. lambda -1 prefers chains with much GPU time, +1
// those with little.
//
// Source: M. Guenzel et al., "EDF-Like Scheduling for Self-Suspending Real-Time Tasks" (RTSS 2022).
// A task whose laxity is negative ranks last, as in edf.
#pragma once

#include "host/sched/snapshot.h"

namespace urgengo::sched {

constexpr Key saedf_key(const SlotView& v, double lambda) {
    const Key aware =
        v.deadline.count() + static_cast<Key>(lambda * static_cast<double>(v.chain.gpu.count()));
    return late_last(v, aware);
}

}  // namespace urgengo::sched
