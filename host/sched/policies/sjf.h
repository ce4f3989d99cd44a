// SPDX-License-Identifier: Apache-2.0
//
// sjf: shortest job first: smallest estimated remaining time, GPU and CPU.
#pragma once

#include "host/sched/snapshot.h"

namespace urgengo::sched {

constexpr Key sjf_key(const SlotView& v) {
    return (v.remaining.gpu + v.remaining.idle + v.remaining.cpu).count();
}

}  // namespace urgengo::sched
