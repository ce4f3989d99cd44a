// SPDX-License-Identifier: Apache-2.0
//
// feasible (default): earliest deadline first among the instances that can all still be met; the
// others wait for gaps.
//
// Under overload, least laxity makes instances take turns until all of them are late, and earliest
// deadline first lets one late instance push the next over the edge. Both finish work that comes
// too late to count. So, when tasks come to the GPU or leave it (with plenty of time, when
// instances begin), and now and then between:
//
//  1 Play what is to come in deadline order: the GPU segment at hand of every instance, from now or
//    from when its CPU segment should end, then the CPU time of the chain's later tasks, then their
//    GPU time. A segment's deadline is the instance's less what comes after the segment. Chains'
//    next frames take part, a period after the last ones. The GPU serves the first in that order;
//    what a task that launches more slowly than the GPU executes leaves of it
//    (SlotView::gpu_share), it gives to the next ones, so that such a task never takes less than
//    its time alone.
//  2 When an instance would end late, not all that wanted the GPU before can be met: give up the
//    least critical of them; among equals the one that frees the most GPU time for the miss ratio
//    that it costs. A miss costs a chain 1/frames, so that is the largest remaining time over
//    period. Play again, until all that are kept are in time. Only instances whose estimates their
//    task's record supports are given up (model/estimate_factor.h).
//  3 Those that are kept go first, by their segments' deadlines; then the given-up ones, the most
//    critical first; then those whose laxity is negative anyway. But a late one goes before all
//    where those that are kept are in time even so: its frame is lost, its chain's next ones need
//    not wait for it.
//
//  4 One that is kept may run beside those before it when each of these is in time by
//    `share_slack`: they end later for it, those behind it do not, since together the two take less
//    time than one after the other.
//
// Giving up is not for good: the set is chosen anew, so an instance comes back when others finish
// early or in each other's shade.
//
// Source: J. M. Moore, "An n job, one machine sequencing algorithm for minimizing the number of
// late jobs" (1968, with Hodgson's simplification), greedily weighted, with releases. What it is
// worth: host/sched/README.md.
#pragma once

#include "host/sched/snapshot.h"

namespace urgengo::sched {

/// @param active  views of all that work on an instance, on the GPU or on the CPU, and of those
/// that
///                should arrive soon; from the 65th on they are left out
/// @param margin  GPU times are taken to be so much longer: what launches, marks and switches cost
/// @param share_slack  who has less time to spare shares the GPU with nobody behind it
/// @threads any; pure, takes time quadratic in their number for each that is given up
/// @param load  GPU time of all chains over their periods: above kMostLoad nothing late goes first,
/// as
///              what looks like room is the next frames'
Plan make_plan(nanoseconds now, std::span<const SlotView> active, double margin,
               nanoseconds share_slack, double load = 0);
inline constexpr double kMostLoad = 0.95;

Key feasible_key(const SlotView& v, const Snapshot& snapshot);

}  // namespace urgengo::sched
