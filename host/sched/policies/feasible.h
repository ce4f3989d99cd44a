// SPDX-License-Identifier: Apache-2.0
//
// feasible (default): earliest deadline first among the instances that can all still be met; the
// others wait for gaps.
//
// Under overload, least laxity makes instances take turns until all of them are late, and earliest
// deadline first lets one late instance push the next over the edge. Both finish work that comes
// too late to count. So, at every decision:
//
//  1 Take the instances on the GPU in order of their deadline (less the CPU time that is still to
//    come), and add up their remaining GPU time, alone on the GPU.
//  2 When the sum passes an instance's deadline, not all so far can be met: give up the one that
//    frees the most GPU time for the miss ratio that it costs. A miss costs a chain 1/frames, so
//    that is the largest remaining time over period.
//  3 Those that are kept go first, by deadline; then the given-up ones; then those whose laxity is
//    negative anyway.
//
// Giving up is not for good: the set is chosen anew at every decision, so an instance comes back
// when others finish early or in each other's shade.
//
// Source: J. M. Moore, "An n job, one machine sequencing algorithm for minimizing the number of
// late jobs" (1968, with Hodgson's simplification), greedily weighted. Overall misses of the ten
// chains at f_a 0.9 / 1.1 / 1.3: least laxity 3.9 / 18.2 / 48.3 %, deadline order 2.7 / 13.6 / 34.6
// %, this 2.3 / 10.8 / 27.0 % (H200, 2026-11-21, tools/bench/results/2026-11-21_h200_orders.json).
#pragma once

#include "host/sched/snapshot.h"

namespace urgengo::sched {

/// @param[out] keys  shape [snapshot.tasks.size()]
void feasible_keys(const Snapshot& snapshot, std::span<Key> keys);

}  // namespace urgengo::sched
