// SPDX-License-Identifier: Apache-2.0
//
// feasible (default): earliest deadline first among the instances that can all still be met; the
// others wait for gaps.
//
// Under overload, least laxity makes instances take turns until all of them are late, and earliest
// deadline first lets one late instance push the next over the edge. Both finish work that comes
// too late to count. So, when tasks come to the GPU or leave it, and now and then between:
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
//    not wait for it. So does one whose work should be over by now. Late ones go by their
//    deadlines; of those that slow each other's launching the least late first. A program runs late
//    frames to their end: by deadlines all chains stay equally late, for seconds, while a chain
//    that catches up stays in time. (Eight eager networks at 0.9 of what Python's lock lets
//    through, in turns, H100, 2026-11-26: 30 to 35 % missed in four phases, by deadlines 29 to 65,
//    bare 60 to 75. Among those that only share the GPU it was worse as often as better: seven
//    traced networks and ten chains under overload, simulated.) None of those goes before all that
//    are in time: where all are late each of them could, and that is by deadlines again. (Until
//    it was so all stayed late, once they were, where launching was all but used up: 70 % missed
//    where 16 are now, bare 64; simulated, docs/measurements.md, "Turns at Python's lock".)
//
//  4 One that is kept may run beside those before it when each of these is in time by half of what
//    remains of it and 3 ms, or by `share_slack` if that is less: they end later for it, those
//    behind it do not, since together the two take less time than one after the other. The 3 ms are
//    for what is under way when the others are held again: a task of short kernels beside one of
//    long ones gets a quarter of its speed meanwhile. (In time by what remains was not enough: it
//    falls as fast as the slack does, so tight chains of short kernels ended with none of either,
//    late. Ten chains at 0.7 and 0.9, H200, one machine: 0.5 and 0.5 % missed, in time by 10 ms 0.0
//    and 0.1; simulated 0.4 and 0.9, since 0.2 and 0.6. Seven networks never have 10 ms.)
//    Beside a launch-bound one little is under way: there it is what remains. Where the GPU works
//    for both for less than two thirds of their time (SlotView::gpu_share), they are less in each
//    other's way: what the other one does in its share of the time, and of that what meets the
//    GPU work of the first. A hold of such a task takes from its launching, and no other task
//    gets more for it. (Seven networks, each launching for 2.6 ms what the GPU needs 1 ms for,
//    all threads stalled for 2 ms each 30 ms, simulated: 11.5 % missed before, 1.8 now, bare 2.6;
//    docs/measurements.md.)
//
//  5 Where all chains need more than the GPU has, one after the other, but not side by side, more
//    share than share_limit allows (Load::has_to_share): else the GPU has room, and all are late.
//    Seven traced networks at 2.7 times their rates, simulated, GPU times over periods 1.1, and
//    0.87 by their utilisation: 14 % missed, 8.6 with hints; with 1.6 3.5, with 2 0.0, as bare. The
//    ten chains, whose kernels fill a GPU, at 1.2 times theirs, 1.03 and 0.93: 6 %, all side by
//    side 31.
//
//  6 Where a chain launches for most of its period, as others slow it down, launching is what they
//    all wait for, and a hold takes of that: none for lack of room (Load::launching_is_scarce).
//    Seven traced networks, simulated, where launching is all but used up: 27 % missed, 11 by 6
//    and launch_contention.h, 5, bare 10; of another GPU's profile 14, 0, and 0.
//
//  7 Beside a busy bystander, where priorities are all there is, those that are kept go by when
//    they have to go on, as things are there: each kernel waits for a part of the bystander's, and
//    that is most of what a task takes, whatever else is on the GPU. So a deadline alone says
//    little. (Seven traced networks beside matrix products, simulated: 4.1 % missed by deadlines,
//    2.1 so, PAAM 5.6; docs/measurements.md.)
//
// Giving up is not for good: the set is chosen anew, so an instance comes back when others finish
// early or in each other's shade.
//
// Source: J. M. Moore, "An n job, one machine sequencing algorithm for minimizing the number of
// late jobs" (1968, with Hodgson's simplification), greedily weighted, with releases. What it is
// worth: host/sched/README.md.
#pragma once

#include "host/sched/snapshot.h"

#include <algorithm>
#include <vector>

#include "host/sched/given_up.h"

namespace urgengo::sched {

/// GPU work without a pause of the program's, as it is alone.
struct PlannedPart {
    nanoseconds time{0};      ///< alone, waits of the GPU for its launches included
    double share = 1;         ///< of that time, in which the GPU works for it
    double launch_share = 0;  ///< LaunchingView::share, if it waits for its launches
};

/// What remains of an instance: a GPU segment, and all that comes after it.
struct PlannedJob {
    const SlotView* view = nullptr;
    bool given_up = false;
    bool may_be_late = false;  ///< it is late, or no instance may be given up for it
    PlannedPart first, last;   ///< with the margin
    nanoseconds reserve{0};    ///< kept free before its deadline
    // Played:
    bool is_last_part = false;
    double rate = 0;       ///< at which it gets on, of its speed alone
    nanoseconds ready{0};  ///< when the part at hand can begin
    nanoseconds left{0};   ///< of its time alone
    nanoseconds due{0};    ///< deadline of the part at hand
    nanoseconds slack{0};  ///< once it is done: the time before its deadline

    const PlannedPart& part() const { return is_last_part ? last : first; }
    bool is_last_gpu() const { return is_last_part || last.time.count() == 0; }
    void begin() {
        is_last_part = false;
        ready = view->release;
        left = first.time;
        due = view->deadline - last.time - view->later.cpu;
    }
    /// With the first part done, the last one is at hand.
    void begin_last(nanoseconds now) {
        is_last_part = true;
        ready = now + view->later.cpu;
        left = last.time;
        due = view->deadline;
    }
    nanoseconds until_done() const {
        if (rate >= 1) return left;
        return nanoseconds(static_cast<std::int64_t>(static_cast<double>(left.count()) / rate) + 1);
    }
    void advance(nanoseconds time) {
        if (rate < 1)
            time = nanoseconds(static_cast<std::int64_t>(static_cast<double>(time.count()) * rate));
        left -= time;
    }
};

/// What all chains need, over their periods.
struct Load {
    double gpu = 0;        ///< GPU time, as if one went after the other
    double shared = 0;     ///< the same by the part of the GPU that their kernels take
    double launching = 0;  ///< of what those share that take turns at launching
    double contended = 0;  ///< the most of its period that a chain launches, slowed down by others

    /// Above it nothing late goes first: what looks like room is the next frames'.
    static constexpr double kMost = 0.95;
    /// So much less than one by one they need side by side, at most, where that is worth it.
    static constexpr double kWorthSharing = 0.85;
    /// A chain that launches for so much of its period, slowed down, has no time for a hold.
    static constexpr double kScarce = 0.7;

    bool leaves_room() const { return std::max(gpu, launching) < kMost; }
    bool launching_is_scarce() const { return contended >= kScarce; }
    /// One after the other they cannot all be met, but side by side they can.
    bool has_to_share() const {
        return gpu >= kMost && shared < kMost && shared <= kWorthSharing * gpu;
    }
};

/// What a plan is made in: tens of kilobytes, which a program's small stack has no room for.
struct PlanScratch {
    /// @param most  so many instances are planned for; the others are left out
    explicit PlanScratch(std::size_t most) {
        jobs.reserve(most);
        ready.reserve(most);
        pending.reserve(most);
        reasons.reserve(most);
    }
    std::vector<PlannedJob> jobs;
    // While they are played:
    std::vector<PlannedJob*> ready;    ///< by the deadline of the part at hand
    std::vector<PlannedJob*> pending;  ///< the part at hand can begin later
    /// Why those were given up that have a slot, by the last plan that was made in it.
    struct Reason {
        int task = -1;
        const SlotView* missed = nullptr;  ///< what would have been late
        nanoseconds by{0};
    };
    std::vector<Reason> reasons;
};

/// @param active   views of all that work on an instance, on the GPU or on the CPU, and of those
///                 that should arrive soon
/// @param margin  GPU times are taken to be so much longer: what launches, marks and switches cost
/// @param share_slack  an instance with less to spare does not share the GPU with those behind it
/// @param scratch  not used by another thread meanwhile
/// @threads any; pure, takes time quadratic in their number for each that is given up
Plan make_plan(nanoseconds now, std::span<const SlotView> active, double margin,
               nanoseconds share_slack, PlanScratch& scratch, const Load& load = {});
/// The same with room of its own for all of them.
inline Plan make_plan(nanoseconds now, std::span<const SlotView> active, double margin,
                      nanoseconds share_slack, const Load& load = {}) {
    PlanScratch scratch(active.size());
    return make_plan(now, active, margin, share_slack, scratch, load);
}

/// Of the GPU segment at hand.
constexpr nanoseconds segment_deadline(const SlotView& v) {
    return v.deadline - v.later.gpu - v.later.idle - v.later.cpu;
}

/// Behind all that can be met. Those that launch in turn come after all other late ones, the least
/// late first, and after them their frames that came too early (sched/bandwidth.h).
constexpr Key late_key(const SlotView& v, const Standing& standing) {
    constexpr Key kAfterAnyDeadline = kLate / 4;
    const Key deadline = v.deadline.count();
    if (standing.late_first) return deadline;
    // A lent deadline makes more urgent, never less.
    if (v.launching.slowed != model::Launching::kSlowed || v.state.is_lent) return kLate + deadline;
    const bool is_early = v.chain.relative_deadline.count() > 0 && v.arrival() > standing.now;
    return kLate + kAfterAnyDeadline + (is_early ? deadline : -deadline);
}

/// When it has to go on, as things are beside a busy bystander.
constexpr Key key_beside(const SlotView& v, const Standing& standing) {
    return (standing.now + v.laxity - v.longer_beside).count();
}

/// Given-up instances rank behind the kept ones and before the late ones; within a step of
/// criticality by their deadline, as far as six days ahead.
constexpr Key feasible_key(const SlotView& v, const Standing& standing) {
    constexpr Key kGivenUp = kLate / 2, kCriticalityStep = Key{1} << 49, kMostCritical = 2047;
    const nanoseconds due = segment_deadline(v);
    if (v.laxity.count() < 0) return late_key(v, standing);
    if (!standing.given_up)
        return v.longer_beside.count() > 0 ? key_beside(v, standing) : due.count();
    const Key ahead = std::clamp((due - standing.now).count(), Key{0}, kCriticalityStep - 1);
    const Key criticality = std::clamp(Key{v.chain.criticality}, Key{0}, kMostCritical);
    return kGivenUp + (kMostCritical - criticality) * kCriticalityStep + ahead;
}

}  // namespace urgengo::sched
