// SPDX-License-Identifier: Apache-2.0
#include "host/sched/estimates.h"

#include <algorithm>
#include <cmath>

#include "host/base/memory_orders.h"
#include "host/sched/run_ahead.h"

namespace urgengo::sched {
namespace {

constexpr double kReckonBeyond = 0.05;
/// A plan that is off by so much is not to be trusted.
constexpr double kContradicts = 1.25;
constexpr int kRetryAfter = 8;
/// Launching for less time tells too little of its speed.
constexpr nanoseconds kTellsOfSpeed{200'000};
constexpr std::int64_t kThousand = 1000;

}  // namespace

void Estimates::segment_begins(GovernedTask& task, std::size_t position, nanoseconds now) const {
    GovernedRun& run = task.run;
    run.segment = {.time = now,
                   .held_idle = run.waited.held_idle,
                   .held = run.waited.held + run.waited.paced,
                   .launched = task.work.launched,
                   .position = position,
                   .alone = company_.is_alone()};
    run.wait_begin = nanoseconds{0};
    // The first launch's time is where its segment's times begin.
    run.window = {now, run.segment.held, task.work.launched, position + 1};
    task.slot->launch_speed_pm.store(0, kRelaxed);
}

void Estimates::sees_launchers(GovernedTask& task, nanoseconds now) const {
    model::LaunchContention::Instance& launching = task.run.launching;
    const Launchers others = others_launching(task, now);
    ++launching.marks;
    launching.others += others.slowed;
    launching.free += others.free;
    launching.unknown |= company_.has_unmarked();
    launching.beside += others.slowed >= std::max(scheduler_.packing.launchers, 1);
    publish_speed(task, now);
}

// A task that launches more slowly than the GPU executes takes the less of it the more its
// launching is slowed down. What one takes that is as fast as the GPU does not depend on that.
void Estimates::publish_speed(GovernedTask& task, nanoseconds now) const {
    if (task.plan.is_empty() || task.record.learns) return;
    GovernedRun& run = task.run;
    const nanoseconds waited = run.waited.held + run.waited.paced;
    const nanoseconds took = now - run.window.begin - (waited - run.window.waited);
    if (took.count() >= 0 && took < kTellsOfSpeed) return;
    const nanoseconds by_profile =
        task.plan.launch_time(run.position) - task.plan.launch_time(run.window.position);
    const nanoseconds work = model::corrected(*task.slot, task.work.launched - run.window.launched);
    const nanoseconds alone(static_cast<std::int64_t>(task.record.contention.pace() *
                                                      static_cast<double>(by_profile.count())));
    // Behind a gate it waits while it launches: that tells nothing.
    const bool tells = took.count() > 0 && alone > work;
    const std::int64_t speed_pm =
        tells ? std::clamp<std::int64_t>(kThousand * alone.count() / took.count(), 1, kThousand)
              : 0;
    task.slot->launch_speed_pm.store(static_cast<std::uint16_t>(speed_pm), kRelaxed);
    run.window = {now, waited, task.work.launched, run.position};
}

Estimates::Launchers Estimates::others_launching(const GovernedTask& task, nanoseconds now) const {
    const bool is_of_use = scheduler_.packing.launchers > 0 &&
                           scheduler_.admission == config::Admission::kPacked &&
                           !task.plan.is_empty() && !task.record.learns;
    if (!is_of_use) return {};
    Launchers others;
    if (company_.is_alone()) return others;
    tasks_.for_each_active([&](const GovernedTask& other) {
        if (&other == &task || !model::is_launching(*other.slot, now)) return;
        const bool is_free = other.slot->launching.load(kRelaxed) == model::Launching::kFree;
        ++(is_free ? others.free : others.slowed);
    });
    return others;
}

/// @returns whether one of those before the task that pause now, and so may be waiting for what its
///          thread has, has got on while it was held. One that was past that already has made one
///          more launch: that tells nothing.
bool Estimates::have_paused_got_on(const GovernedTask& task, const TaskSet& before,
                                   nanoseconds since) const {
    const nanoseconds settled = since + model::kLaunchGrace;
    bool any = false;
    tasks_.for_each_active([&](const GovernedTask& other) {
        const abi::TaskSlot& slot = *other.slot;
        any |= &other != &task && before.contains(other.index) &&
               slot.state.load(kRelaxed) == abi::TaskState::kGpu &&
               slot.head_remaining_ns.load(kRelaxed) > 0 &&
               model::may_need_same_lock(slot.launching.load(kRelaxed)) &&
               nanoseconds(slot.launch_ns.load(kRelaxed)) > settled;
    });
    return any;
}

void Estimates::segment_ended(GovernedTask& task, std::size_t position, bool beside_bystanders,
                              nanoseconds now) const {
    GovernedRun& run = task.run;
    const GovernedRun::SegmentBegin& begin = run.segment;
    model::EstimateFactor::Instance& sum = run.estimate.measured;
    const bool alone = begin.alone && company_.was_alone_since(begin.time);
    sum.alone = alone && (sum.alone || sum.estimated.count() == 0);
    // A task that meets no other on the GPU does not look otherwise.
    run.estimate.beside_bystanders |= beside_bystanders;
    sum.estimated += task.work.launched - begin.launched;
    sum.most += now - begin.time - (run.waited.held_idle - begin.held_idle);
    const nanoseconds held = run.waited.held + run.waited.paced - begin.held;
    sum.waited += held - (run.waited.held_idle - begin.held_idle);
    if (run.wait_begin.count() == 0) return;
    sum.least += now - run.wait_begin;
    sum.waited += now - run.wait_begin;
    run.launching.took += run.wait_begin - begin.time - held;
    run.launching.alone +=
        std::max(task.plan.launch_time(position) - task.plan.launch_time(begin.position + 1),
                 nanoseconds{0});
}

std::optional<bool> Estimates::instance_ended(GovernedTask& task, nanoseconds now) {
    GovernedRun& run = task.run;
    if (run.observed) return std::nullopt;
    judge_support(task);
    // Times that are learned need no factor.
    if (task.record.learns || !run.estimate.is_measured) return std::nullopt;
    if (run.estimate.beside_bystanders) tell_of_bystanders(task);
    if (task.plan.is_empty())
        task.record.factor.observe_unknown(run.estimate.measured);
    else
        task.record.factor.observe(run.estimate.measured);
    const double factor = task.record.factor.value();
    task.slot->factor_ppm.store(model::to_ppm(factor), kRelaxed);
    task.estimated.gpu_ns.store(
        static_cast<std::int64_t>(factor * static_cast<double>(task.plan.gpu_time().count())),
        kRelaxed);
    if (run.estimate.measured.alone && run.launching.marks == 0)
        run.launching.marks = 1;  // none was needed
    task.record.contention.observe(run.launching, now);
    reckon(task);
    publish_launching(task);
    return !task.plan.is_empty() && (factor > kContradicts || factor * kContradicts < 1);
}

void Estimates::waited_for_turn(GovernedTask& task, const Decision& decision, nanoseconds since,
                                nanoseconds now) {
    // A loan ends holds for reasons of its own.
    if (!decision.launches_late && decision.rank != abi::kMaxTasks)
        task.record.contention.held(
            decision.others_pause && !have_paused_got_on(task, decision.before, since), now);
    publish_launching(task);
}

// An end that no wait tells of says nothing of the times; where none ever does, the profile is all
// that there is.
void Estimates::judge_support(GovernedTask& task) const {
    task.record.given_up_in_a_row = plan_.gives_up(task) ? task.record.given_up_in_a_row + 1 : 0;
    const bool retries = task.record.given_up_in_a_row >= kRetryAfter;
    if (retries) task.record.given_up_in_a_row = 0;
    const bool is_supported =
        task.record.factor.instances() == 0 || task.record.factor.is_supported();
    if (is_supported && task.slot->instance.load(kRelaxed) >= model::EstimateFactor::kRecent)
        task.slot->is_supported.store(!retries, kRelaxed);
}

void Estimates::tell_of_bystanders(GovernedTask& task) const {
    GovernedRun& run = task.run;
    const double expected_ns =
        task.record.factor.value() * static_cast<double>(run.estimate.measured.estimated.count()) +
        static_cast<double>(task.estimated.idle_ns.load(kRelaxed));
    // A launch-bound task does not notice.
    if (run.estimate.measured.alone && task.record.factor.is_supported() && expected_ns > 0 &&
        !is_launch_bound(task))
        bystanders_.measured(run.estimate.measured.most,
                             nanoseconds(static_cast<std::int64_t>(expected_ns)),
                             static_cast<double>(run.position) * task.plan.kernels_of_launch());
    run.estimate.measured.alone = false;
}

// What remains is taken to have as many kernels for its time as the task's whole plan.
nanoseconds Estimates::longer_beside(const SlotView& view) const {
    const GovernedTask& task = tasks_[view.task];
    const auto gpu_ns = static_cast<double>(task.estimated.gpu_ns.load(kRelaxed));
    if (task.plan.is_empty() || task.record.learns || gpu_ns <= 0) return nanoseconds{0};
    const double share = static_cast<double>(view.remaining.gpu.count()) / gpu_ns;
    return bystanders_.longer(share * static_cast<double>(task.plan.num_with_graphs()));
}

void Estimates::reckon(GovernedTask& task) {
    const double factor = task.record.factor.value(), pace = task.record.contention.pace();
    const bool is_contended = task.record.contention.is_contended() && is_launch_bound(task);
    const auto write = [](std::atomic<bool>& to, bool value) {
        if (to.load(kRelaxed) != value) to.store(value, kRelaxed);
    };
    write(task.is_contended, is_contended);
    write(task.is_crowded, is_contended && task.record.contention.is_parallel());
    if (std::abs(factor / task.record.reckoned_factor - 1) <= kReckonBeyond &&
        std::abs(pace / task.record.reckoned_pace - 1) <= kReckonBeyond)
        return;
    task.plan.reckon_idle(factor, pace);
    task.record.reckoned_factor = factor;
    task.record.reckoned_pace = pace;
    task.estimated.idle_ns.store(task.plan.idle_from(0).count(), kRelaxed);
    plan_.reckon_load();
}

void Estimates::publish_launching(GovernedTask& task) {
    const model::Launching verdict = task.record.contention.verdict();
    if (task.slot->launching.load(kRelaxed) == verdict) return;
    task.slot->launching.store(verdict, kRelaxed);
    plan_.reckon_load();
}

}  // namespace urgengo::sched
