// SPDX-License-Identifier: Apache-2.0
//
// Packed admission, as the Governor and the GPU's dispatcher share it: what a task is to the others
// in the order, and whether a launch fits beside those that come before it (admission.h says why).
// Integers only: host and GPU, each in its own order, sum to the same.
//
// @threads any; pure
#pragma once

#include <algorithm>
#include <cstdint>

#include "host/sched/policy.h"

namespace urgengo::sched {

/// Shares of the GPU in parts of a million.
inline constexpr std::int64_t kWholeGpu = 1'000'000;

constexpr std::int64_t to_load(double utilization) {
    return static_cast<std::int64_t>(utilization * static_cast<double>(kWholeGpu) + 0.5);
}
constexpr double to_utilization(std::int64_t load) {
    return static_cast<double>(load) / static_cast<double>(kWholeGpu);
}

/// GPU work that is over sooner is not worth a hold: a few polls.
inline constexpr std::int64_t kWorthHolding_ns = 250'000;

/// What a task takes of the GPU; when exactly within its time alone is not known.
/// @param at_once  GPU work that comes without a pause
constexpr std::int64_t load_of(const SlotView& v, nanoseconds at_once) {
    if (v.state.needs_all || at_once.count() >= kWorthHolding_ns) return to_load(v.utilization);
    return to_load(v.utilization * v.gpu_share());
}

/// The order of all: by the policy's key, ties by index. Host and GPU sort by it.
constexpr bool comes_before(Key key, int task, Key other_key, int other_task) {
    return key != other_key ? key < other_key : task < other_task;
}

/// A task in the order.
struct Contender {
    Key key = 0;
    int task = 0;
    bool blocks = false;      ///< SlotView::blocking
    bool can_be_met = false;  ///< holding others can still be of use to it
    bool demoted = false;
    bool needs_all = false;
    std::int64_t load = 0;  ///< of what it has on the GPU
    std::int64_t own = 0;   ///< of what it wants to launch

    constexpr bool is_before(const Contender& other) const {
        return comes_before(key, task, other.key, other.task);
    }
};

/// Whether holding others can still be of use to it. A late or given-up task has its rank and the
/// priority that comes with it. Among late ones, one at a time took so much of the GPU's capacity
/// that they stayed late (seven traced networks, H100: 13 % missed, 1.4 bare).
constexpr bool can_be_met(const SlotView& v, bool given_up) {
    return (v.laxity.count() >= 0 && !given_up) || v.state.starved || v.state.needs_all;
}

constexpr Contender contender_of(config::Policy policy, const Standing& standing,
                                 const SlotView& v) {
    return {.key = key_of(policy, standing, v),
            .task = v.task,
            .blocks = v.state.blocking,
            .can_be_met = can_be_met(v, standing.given_up),
            .demoted = v.state.demoted,
            .needs_all = v.state.needs_all,
            .load = load_of(v, v.ahead.launched),
            .own = load_of(v, v.next)};
}

/// Summed over those before a task in the order.
struct Before {
    std::int64_t load = 0;  ///< of those that it has to leave room for
    int blockers = 0;       ///< how many these are
    int blocking = 0;       ///< with those that cannot be met

    constexpr Before operator+(const Before& other) const {
        return {load + other.load, blockers + other.blockers, blocking + other.blocking};
    }
};
constexpr Before as_before(const Contender& c) {
    const bool counts = c.blocks && c.can_be_met;
    return {counts ? c.load : 0, counts, c.blocks};
}

/// How much may run side by side.
struct PackLimits {
    std::int64_t pack = 0;   ///< scheduler.pack_limit
    std::int64_t share = 0;  ///< scheduler.share_limit, or that if it is more
    nanoseconds share_slack{0};
    nanoseconds plan_slack{0};  ///< Plan::slack

    /// Nothing is added while another task waits for all GPU work.
    constexpr std::int64_t now(bool may_share, bool others_need_all) const {
        return !others_need_all && (may_share || plan_slack >= share_slack) ? share : pack;
    }
};

/// Where all have to share, two or three are side by side; where launching is scarce, all.
inline constexpr std::int64_t kShareOfAll = 2 * kWholeGpu;
inline constexpr std::int64_t kNoLimit = abi::kMaxTasks * kWholeGpu;

/// @returns how much may run side by side while the plan stands. The host's: the GPU is told.
inline PackLimits limits_of(const config::Packing& packing, const Plan& plan) {
    PackLimits limits{.pack = to_load(packing.limit),
                      .share = to_load(std::max(packing.share_limit, packing.limit)),
                      .share_slack = packing.share_slack,
                      .plan_slack = plan.slack};
    if ((plan.has_to_share || plan.launching_is_scarce) && limits.share > limits.pack) {
        limits.share = std::max(limits.share, plan.launching_is_scarce ? kNoLimit : kShareOfAll);
        limits.plan_slack = nanoseconds::max();
    }
    return limits;
}

/// Nothing blocks before it. For a demoted task all do.
constexpr bool is_free(const Contender& self, const Before& before) {
    return (self.demoted ? before.blocking : before.blockers) == 0;
}

/// @param limit  PackLimits::now()
constexpr bool fits(const Contender& self, const Before& before, std::int64_t limit) {
    return is_free(self, before) || (!self.demoted && before.load + self.own <= limit);
}

}  // namespace urgengo::sched
