// SPDX-License-Identifier: Apache-2.0
//
// eqdf: earliest quasi-deadline first: smallest t_arr + D + lambda * C, where C is the chain's CPU
// time. lambda -1 prefers chains with much CPU time still to come, +1 those with little.
//
// Source: M. Guenzel et al., "EDF-Like Scheduling for Self-Suspending Real-Time Tasks" (RTSS 2022).
// A task whose laxity is negative ranks last, as in edf.
#pragma once

#include "host/sched/snapshot.h"

namespace urgengo::sched {

constexpr Key eqdf_key(const SlotView& v, double lambda) {
    const Key quasi =
        v.deadline.count() + static_cast<Key>(lambda * static_cast<double>(v.chain.cpu.count()));
    return late_last(v, quasi);
}

}  // namespace urgengo::sched
