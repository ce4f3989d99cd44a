// SPDX-License-Identifier: Apache-2.0
//
// edf: earliest absolute deadline t_arr + D first. A task whose laxity is negative cannot meet its
// deadline any more and ranks last, by deadline.
#pragma once

#include "host/sched/snapshot.h"

namespace urgengo::sched {

constexpr Key edf_key(const SlotView& v) {
    return late_last(v, v.deadline.count());
}

}  // namespace urgengo::sched
