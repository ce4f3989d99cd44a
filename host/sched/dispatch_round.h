// SPDX-License-Identifier: Apache-2.0
//
// A dispatcher's round: which closed gates open now. Host threads and the GPU run the same round
// over the active kernel buffer (device/dispatch_round.cuh); only how they sort and sum differs:
// the host by std::stable_sort, one after the other, the GPU by CUB.
//
//   1 Every active task is read and viewed (model/task_reading.h). Of a gated one, the launch at
//     hand is the group of launches behind its first closed gate.
//   2 All are ranked by the policy's key, ties by index.
//   3 A gate opens if its group fits beside those before it (contender.h), and its task is not
//     ahead of the GPU by more than its run-ahead. Two groups fit in that, so that the stream never
//     drains.
//   4 It opens all the same once its time has come (TaskSlot::gate_by_ns), and while the dispatcher
//     is parked.
//   5 The task's next gates may open in the same round, by the same rule.
//   6 The laxity and the rank of each are told (abi::RankedWord), and the GPU's rounds record the
//     highest urgency, for TH_urgent.
//
// @threads any; opening is idempotent
#pragma once

#include <atomic>
#include <vector>

#include "host/model/task_reading.h"
#include "host/sched/contender.h"
#include "urgengo/abi/dispatcher.h"

namespace urgengo::sched {

using model::TaskReading;

/// More than that of a task's gates never open in a round.
inline constexpr int kMostOpenedAtOnce = 4;

/// The group of launches behind a gate.
struct GateGroup {
    std::int64_t begin_ns = 0;  ///< TaskSlot::launched_ns before it
    std::int64_t time_ns = 0;
    std::uint32_t utilization_ppm = 0;
};
URGENGO_HOST_DEVICE inline GateGroup load_group(const abi::TaskSlot& slot, std::uint32_t gate) {
    const std::uint32_t at = gate % abi::kGateRing;
    return {load_shared(slot.group_begin_ns[at]), load_shared(slot.group_time_ns[at]),
            load_shared(slot.group_utilization_ppm[at])};
}

/// What a round knows of a task.
struct Entrant {
    Contender contender;
    std::int64_t laxity_ns = 0;
    bool is_ranked = false;  ///< SlotView: it is on the GPU, or about to be
    bool is_gated = false;
    bool may_share = false;          ///< Plan::may_share
    bool may_be_held = true;         ///< else its gates open
    std::uint32_t opened = 0;        ///< gates so far
    std::uint32_t closed = 0;        ///< of all that there are
    std::int64_t open_until_ns = 0;  ///< launched_ns up to which its run-ahead lets it go
    GateGroup head;                  ///< behind its first closed gate
};

/// What a round is told of the config and the plan.
struct RoundSettings {
    config::Policy policy = config::Policy::kFeasible;
    double lambda = 1;
    bool is_parked = false;
    PackLimits limits;
};
URGENGO_HOST_DEVICE inline RoundSettings load_settings(const abi::DispatchSettings& page) {
    RoundSettings s;
    s.policy = static_cast<config::Policy>(load_shared(page.policy));
    s.lambda = load_shared(page.lambda);
    s.is_parked = load_shared(page.parked) != 0;
    s.limits = {load_shared(page.pack_limit_ppm), load_shared(page.share_limit_ppm),
                nanoseconds(load_shared(page.share_slack_ns)),
                nanoseconds(load_shared(page.plan_slack_ns))};
    return s;
}

/// The same of the config, once: the plan's are the plan's (standing_plan.h).
void store_settings(abi::DispatchSettings& page, const config::Scheduler& scheduler);

/// @param globaltimer  the GPU's, now
/// @returns that on CLOCK_MONOTONIC
URGENGO_HOST_DEVICE inline nanoseconds host_time(const abi::DispatchSettings& page,
                                                 std::uint64_t globaltimer) {
    constexpr int kUnused = 16;  // of 64 bits: stamps have 48
    const std::uint64_t base = static_cast<std::uint64_t>(load_shared(page.clock_base_ns));
    const std::uint64_t time = globaltimer - load_shared(page.gpu_clock_ahead);
    const auto since = static_cast<std::int64_t>((time - base) << kUnused) >> kUnused;
    return nanoseconds(static_cast<std::int64_t>(base) + since);
}

/// @param standing  with its bits of the plan
/// @param head      of a gated task, its first closed group
constexpr Entrant entrant_of(const TaskReading& r, int task, const RoundSettings& settings,
                             const Standing& standing, bool may_share, const GateGroup& head,
                             std::int64_t gate_by_ns, std::int64_t run_ahead_ns) {
    SlotView view = model::view_of(r, task, standing.now);
    view.state.starved = standing.now.count() < r.until.turn_ns;
    Entrant e;
    e.is_gated = r.is_gated();
    if (e.is_gated) {
        view.next = nanoseconds(head.time_ns);
        if (!view.state.needs_all) view.utilization = head.utilization_ppm * 1e-6;
    }
    e.contender = contender_of(settings.policy, standing, view);
    e.laxity_ns = view.laxity.count();
    e.is_ranked = view.state.ranked;
    e.may_share = may_share;
    e.may_be_held = !settings.is_parked && standing.now.count() < gate_by_ns;
    e.opened = r.gates.opened;
    e.closed = r.gates.closed;
    e.open_until_ns = r.marks.executed_ns + run_ahead_ns;
    e.head = head;
    return e;
}

/// @param group  behind the gate
/// @returns whether the gate opens: it is the task's first closed one
constexpr bool opens(const Entrant& self, const GateGroup& group, const Before& before,
                     const PackLimits& limits, bool others_need_all) {
    if (!self.may_be_held) return true;
    // Nothing of it is under way, or it may be so far ahead.
    if (group.begin_ns > self.open_until_ns) return false;
    Contender launch = self.contender;
    launch.own = to_load(group.utilization_ppm * 1e-6);
    return fits(launch, before, limits.now(self.may_share, others_need_all));
}

/// @param group_of  (std::uint32_t gate) -> GateGroup
/// @returns the last gate that is open after the round
template <typename GroupOf>
URGENGO_HOST_DEVICE std::uint32_t opened_after(const Entrant& self, const Before& before,
                                               const PackLimits& limits, bool others_need_all,
                                               GroupOf&& group_of) {
    std::uint32_t opened = self.opened;
    for (int i = 0; i < kMostOpenedAtOnce && opened != self.closed; ++i) {
        const GateGroup group = i == 0 ? self.head : group_of(opened + 1);
        if (!opens(self, group, before, limits, others_need_all)) break;
        ++opened;
    }
    return self.may_be_held ? opened : self.closed;
}

/// What counts for TH_urgent of all tasks: the least laxity that is not negative, of those on the
/// GPU. @returns kNoLaxity: this one has none
inline constexpr std::int64_t kNoLaxity = INT64_MAX;
constexpr std::int64_t urgent_laxity(const Entrant& e) {
    return e.is_ranked && e.laxity_ns >= 0 ? e.laxity_ns : INT64_MAX;
}

/// The host looks after gates no more (it was stopped, say), as far as the GPU can tell. Threads of
/// ours beat some ten times a millisecond; on busy cores they may lose their turn for milliseconds.
URGENGO_HOST_DEVICE inline bool is_silent(const abi::DispatchSettings& page, nanoseconds now) {
    return now.count() - load_shared(page.beat_ns) > abi::kSilence_ns;
}

/// Opens the gates of a task up to this one. @returns whether it was closed
bool open_gate(abi::TaskSlot& slot, std::uint32_t gate, nanoseconds now);

/// A round of the host's, over what is active in the page.
class HostRounds {
  public:
    explicit HostRounds(abi::SharedPage& page);
    /// One thread at a time; a call beside another one returns at once.
    /// @param gpu  of a simulated GPU's round: what that knows of marks that the host has not seen
    /// @returns how many gates are closed after it
    int run(nanoseconds now, const abi::DispatchState* gpu = nullptr);

  private:
    struct Ranked {
        Entrant entrant;
        abi::TaskSlot* slot;
    };
    abi::SharedPage& page_;
    std::atomic<bool> busy_{false};
    std::atomic<int> closed_{0};
    std::vector<Ranked> ranked_;  // of the one that runs
};

}  // namespace urgengo::sched
