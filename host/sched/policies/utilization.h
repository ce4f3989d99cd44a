// SPDX-License-Identifier: Apache-2.0
//
// utilization: smallest utilisation of the launch at hand first, in millionths: dCUDA's order
// within a group, as the paper characterises it.
#pragma once

#include "host/sched/snapshot.h"

namespace urgengo::sched {

constexpr Key utilization_key(const SlotView& v) {
    return static_cast<Key>(1e6 * v.utilization);
}

}  // namespace urgengo::sched
