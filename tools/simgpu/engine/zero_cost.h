// SPDX-License-Identifier: Apache-2.0
//
// SIMGPU_ZERO_COST=1: no simulation, for measuring what an interposer costs by itself. Launches,
// event records, waits and queries return at once, without a lock, a thread or an allocation, and
// trust their handles: a wrong one is not noticed, or crashes. What has an effect (marks, copies,
// stream writes, host functions) has it in the calling thread, before the call returns; a wait for
// a value is passed at once.
#pragma once

#include "tools/simgpu/api/entry_names.h"

#include <cuda.h>

#include <atomic>

#include "tools/simgpu/engine/stream_queue.h"

namespace urgengo::simgpu {

extern std::atomic<bool> g_zero_cost;

inline bool zero_cost() {
    return g_zero_cost.load(std::memory_order_relaxed);
}

/// Called by cuInit, and in a forked child, where nothing works any more.
void set_zero_cost(bool on);

/// Runs a native kernel here and now; any other does nothing.
CUresult launch_at_no_cost(CUfunction function, void** params, void** extra);

/// Has the effects of the work here and now.
/// @returns a fence that has passed
Fence run_at_no_cost(Work& work);

}  // namespace urgengo::simgpu
