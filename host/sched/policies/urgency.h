// SPDX-License-Identifier: Apache-2.0
//
// urgency: largest UL = 1 / laxity first (Eq. 2 of the paper), that is, least laxity first. A task
// whose laxity is negative has passed the point of no return and ranks last.
#pragma once

#include "host/sched/snapshot.h"

namespace urgengo::sched {

constexpr Key urgency_key(const SlotView& v) {
    const Key lax = v.laxity.count();
    return lax >= 0 ? lax : kLate + lax;
}

}  // namespace urgengo::sched
