// SPDX-License-Identifier: Apache-2.0
#include "host/sched/standing_plan.h"

#include <algorithm>

#include "host/base/memory_orders.h"
#include "host/sched/contender.h"
#include "host/sched/demand.h"
#include "host/sched/expected_frames.h"

namespace urgengo::sched {
namespace {

constexpr nanoseconds kStands{200'000}, kLeastStands{20'000};
constexpr nanoseconds kDear{20'000};
constexpr int kDearStands = 5;

// A reason in one word: us, chain + 1, whether it is the instance itself.
std::uint64_t packed(const GivenUp& why) {
    constexpr std::int64_t kMost_us = 0xffff'ffff;
    const auto us = std::chrono::duration_cast<std::chrono::microseconds>(why.short_by).count();
    return static_cast<std::uint64_t>(std::clamp<std::int64_t>(us, 0, kMost_us)) << 32 |
           static_cast<std::uint64_t>(why.chain + 1) << 1 | (why.itself ? 1 : 0);
}

GivenUp unpacked(std::uint64_t word) {
    return {(word & 1) != 0, static_cast<int>(word >> 1 & 0x7fff'ffff) - 1,
            std::chrono::microseconds(word >> 32)};
}

/// @param cost  of plans of late: they take a part of the time at most
/// @returns until when a plan of `now` stands
nanoseconds stands_until(nanoseconds now, const std::vector<SlotView>& views, nanoseconds cost) {
    nanoseconds stands = kStands;
    for (const SlotView& v : views)
        if (v.laxity.count() >= 0) stands = std::min(stands, v.laxity);
    return now + std::max({stands, kLeastStands, kDearStands * cost});
}

bool is_idle(const GovernedTask& task) {
    return state_of(task) == abi::TaskState::kIdle;
}

// What is read of the others' slots is asked for at once: most comes from the caches of the cores
// that wrote it.
void prefetch(const GovernedTask& task) {
    if (is_idle(task)) return;
    const char* slot = reinterpret_cast<const char*>(task.slot);
    __builtin_prefetch(slot + offsetof(abi::TaskSlot, marks_issued));
    __builtin_prefetch(slot + offsetof(abi::TaskSlot, marks_done));
    __builtin_prefetch(slot + offsetof(abi::TaskSlot, relative_deadline_ns));
    __builtin_prefetch(task.line.load(std::memory_order_relaxed));
    __builtin_prefetch(&task.pending_ns);
}

}  // namespace

void Tasks::publish(const Plan& plan, const PackLimits& limits) const {
    abi::DispatchSettings& page = page_.dispatch;
    page.plan_slack_ns.store(limits.plan_slack.count(), std::memory_order_relaxed);
    page.share_limit_ppm.store(limits.share, std::memory_order_relaxed);
    plan.given_up.copy_to(page.given_up);
    plan.late_first.copy_to(page.late_first);
    plan.may_share.copy_to(page.may_share);
}

StandingPlan::StandingPlan(const config::Scheduler& scheduler, const Tasks& tasks, std::size_t most)
    : scheduler_(scheduler), tasks_(tasks), reasons_(most), scratch_(most) {
    views_.reserve(most);
}

StandingPlan::Answer StandingPlan::plan(nanoseconds now, std::uint32_t& changes,
                                        const GovernedTask& maker) {
    if (scheduler_.policy != config::Policy::kFeasible) return {};
    const auto plan = make_if_due(now, changes, maker.index);
    return plan ? Answer{*plan, true} : Answer{read()};
}

void StandingPlan::refresh(nanoseconds now) {
    if (scheduler_.policy != config::Policy::kFeasible) return;
    std::uint32_t changes = tasks_.changes(kAcquire);
    make_if_due(now, changes, kRefresher);
}

std::optional<Plan> StandingPlan::make_if_due(nanoseconds now, std::uint32_t& changes, int maker) {
    // What a plan was made for is read before the plan.
    const bool stands = changes_.load(kAcquire) == changes && now <= until_.load(kRelaxed);
    int none = kNoMaker;
    if (stands || is_kept(now) || !maker_.compare_exchange_strong(none, maker, kAcquire))
        return std::nullopt;
    const Plan plan = make(now, changes);
    maker_.store(kNoMaker, std::memory_order_release);
    return plan;
}

bool StandingPlan::is_kept(nanoseconds now) const {
    const nanoseconds cost = cost_.load(kRelaxed);
    return cost > kDear && now - time_.load(kRelaxed) < kDearStands * cost;
}

bool StandingPlan::is_due(std::uint32_t changes, nanoseconds now) const {
    return scheduler_.policy == config::Policy::kFeasible && changes_.load(kRelaxed) != changes &&
           !is_kept(now);
}

Plan StandingPlan::make(nanoseconds now, std::uint32_t& changes) {
    views_.clear();
    tasks_.for_each_active([](GovernedTask& task) { prefetch(task); });
    tasks_.for_each_active([&](GovernedTask& task) {
        if (is_idle(task)) return;
        const SlotView view = tasks_.look(task, now);
        if (view.state.active) views_.push_back(view);  // else it was being written
    });
    // Of those that are at work: one that has stopped contends no more.
    double contended = 0;
    for (const SlotView& v : views_)
        if (const GovernedTask& task = tasks_[v.task]; task.is_contended.load(kRelaxed))
            contended = std::max(contended, demand_of(task).gpu_and_launching);
    for (const GovernedChain* chain : tasks_.chains())
        if (const auto view = expected_frame(*chain, tasks_, now)) views_.push_back(*view);
    const Plan plan = make_plan(now, views_, scheduler_.parameters.plan_margin,
                                scheduler_.packing.share_slack, scratch_,
                                {load_.gpu.load(kRelaxed), load_.shared.load(kRelaxed),
                                 load_.launching.load(kRelaxed), contended});
    note_reasons();
    may_share_.store(plan.may_share);
    slack_.store(plan.slack, kRelaxed);
    has_to_share_.store(plan.has_to_share, kRelaxed);
    launching_is_scarce_.store(plan.launching_is_scarce, kRelaxed);
    const bool is_other =
        given_up_.load() != plan.given_up || late_first_.load() != plan.late_first;
    given_up_.store(plan.given_up);
    late_first_.store(plan.late_first);
    if (is_other && tasks_.changed() == changes) ++changes;
    if (scheduler_.dispatch.where != config::Dispatch::kThread)
        tasks_.publish(plan, limits_of(scheduler_.packing, plan));
    time_.store(now, kRelaxed);
    until_.store(stands_until(now, views_, cost_.load(kRelaxed)), kRelaxed);
    changes_.store(changes, std::memory_order_release);
    return plan;
}

// Before the tasks are said to be given up: who sees that finds why.
void StandingPlan::note_reasons() {
    for (const PlanScratch::Reason& reason : scratch_.reasons) {
        const SlotView& missed = *reason.missed;
        const bool is_expected = missed.task == SlotView::kExpected;
        const int chain =
            is_expected ? missed.of_chain : static_cast<int>(tasks_[missed.task].chain->index);
        reasons_[static_cast<std::size_t>(reason.task)].store(
            packed({missed.task == reason.task, chain, reason.by}), kRelaxed);
    }
}

GivenUp StandingPlan::why_given_up(const GovernedTask& task) const {
    const auto index = static_cast<std::size_t>(task.index);
    return index < reasons_.size() ? unpacked(reasons_[index].load(kRelaxed)) : GivenUp{};
}

// A core that was lost meanwhile is no cost of a plan.
void StandingPlan::took(nanoseconds cost) {
    cost_.store(std::min(cost, 10 * kDear), kRelaxed);
}

void StandingPlan::release_if_by(const GovernedTask& maker) {
    int its = maker.index;
    maker_.compare_exchange_strong(its, kNoMaker, std::memory_order_release, kRelaxed);
}

void StandingPlan::reckon_load() {
    Load load;
    for (const GovernedTask* task : tasks_.all()) {
        const Demand demand = demand_of(*task);
        const auto verdict = static_cast<model::Launching>(task->slot->launching.load(kRelaxed));
        load.gpu += demand.gpu;
        load.shared += demand.shared;
        load.launching += tasks_.launch_share(verdict) * demand.gpu_and_launching;
    }
    load_.gpu.store(load.gpu, kRelaxed);
    load_.shared.store(load.shared, kRelaxed);
    load_.launching.store(load.launching, kRelaxed);
}

}  // namespace urgengo::sched
