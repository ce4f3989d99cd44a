// SPDX-License-Identifier: Apache-2.0
//
// fifo: first come, first served: earliest arrival of the frame.
#pragma once

#include "host/sched/snapshot.h"

namespace urgengo::sched {

constexpr Key fifo_key(const SlotView& v) {
    return v.arrival().count();
}

}  // namespace urgengo::sched
