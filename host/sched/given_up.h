// SPDX-License-Identifier: Apache-2.0
//
// Why the plan has given an instance up (policies/feasible.h, 2): for people, nothing is decided by
// it.
#pragma once

#include <chrono>

namespace urgengo::sched {

struct GivenUp {
    bool itself = false;                   ///< it would have been late itself, not another one
    int chain = -1;                        ///< of the other one, index; -1: not known
    std::chrono::nanoseconds short_by{0};  ///< by which that one would have been late
};

}  // namespace urgengo::sched
