// SPDX-License-Identifier: Apache-2.0
//
// A task over several streams, alone on the GPU: when its kernels run, and what each adds to the
// time that the GPU is busy, as `urgengo profile` says it (tools/trace/busy_time.h). Branches are
// taken to fit beside each other. Pure.
#pragma once

#include <vector>

#include "tools/sim/chain_model.h"

namespace urgengo::sim {

struct BranchTimes {
    std::vector<nanoseconds> adds;  ///< by kernel; together: the time that any of them runs
    nanoseconds latency{0};         ///< from the first launch's return to the last one's end
};

/// @param times   of the kernels, each alone
/// @param launch  what a launch takes of the thread, at least
BranchTimes branch_times(const std::vector<nanoseconds>& times, const TaskTraits& traits,
                         nanoseconds launch, const GpuShape& shape);

}  // namespace urgengo::sim
