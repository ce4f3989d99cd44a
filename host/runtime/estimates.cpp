// SPDX-License-Identifier: Apache-2.0
//
// Estimates prove themselves: what each instance took is compared with what the plan says
// (model/estimate_factor.h), and corrects what is said of the next ones. By whoever has the task.
#include <cmath>

#include "host/runtime/runtime.h"

namespace urgengo::runtime {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
/// What the GPU waits for launches depends on how long it works: reckoned anew where that has
/// changed by so much, as it takes time linear in the launches.
constexpr double kReckonBeyond = 0.05;
/// A plan that is off by so much is not to be trusted.
constexpr double kContradicts = 1.25;
/// After so many instances in a row that were given up, one is not: it may be met by now.
constexpr int kRetryAfter = 8;

}  // namespace

void Runtime::measure_begins(TaskState& task, bool alone, nanoseconds now) {
    sched::GovernedRun& run = task.run;
    run.segment = {.time = now,
                   .held_idle = run.held_idle,
                   .held = run.held + run.paced,
                   .launched = task.launched,
                   .position = task.tracker.position(),
                   .alone = alone};
    run.wait_begin = nanoseconds{0};
}

/// A wait for all that the task has launched has ended. While it was held and had nothing on the
/// GPU, none of its work was done; while it was paced, or held with work under way, it was.
void Runtime::measure_ended(TaskState& task, nanoseconds now) {
    sched::GovernedRun& run = task.run;
    const sched::GovernedRun::SegmentBegin& begin = run.segment;
    model::EstimateFactor::Instance& sum = run.measured;
    const bool alone = begin.alone && governor_.company().was_alone_since(begin.time);
    sum.alone = alone && (sum.alone || sum.estimated.count() == 0);
    // A task that is never in anybody's way does not look otherwise.
    run.beside_bystanders |= governor_.are_bystanders_there(now);
    sum.estimated += task.launched - begin.launched;
    sum.most += now - begin.time - (run.held_idle - begin.held_idle);
    const nanoseconds held = run.held + run.paced - begin.held;
    sum.waited += held - (run.held_idle - begin.held_idle);
    if (run.wait_begin.count() > 0) {
        sum.least += now - run.wait_begin;
        sum.waited += now - run.wait_begin;
        run.launching.took += run.wait_begin - begin.time - held;
        run.launching.alone += std::max(task.plan.launch_time(task.tracker.position()) -
                                            task.plan.launch_time(begin.position + 1),
                                        nanoseconds{0});
    }
}

/// The instance has ended. Times that are learned (`learn: on`) need no factor.
void Runtime::correct_estimates(TaskState& task) {
    sched::GovernedRun& run = task.run;
    if (run.observed) return;
    const bool was_given_up = governor_.plan().gives_up(task);
    task.given_up_in_a_row = was_given_up ? task.given_up_in_a_row + 1 : 0;
    const bool retries = task.given_up_in_a_row >= kRetryAfter;
    if (retries) task.given_up_in_a_row = 0;
    // An end that no wait tells of says nothing of the times; where none ever does, the profile is
    // all that there is.
    const bool is_supported = task.factor.instances() == 0 || task.factor.is_supported();
    if (is_supported && task.slot->instance.load(kRelaxed) >= model::EstimateFactor::kRecent)
        task.slot->is_supported.store(!retries, kRelaxed);
    if (task.learning || !run.is_measured) return;
    if (run.beside_bystanders) {
        const double expected =
            task.factor.value() * static_cast<double>(run.measured.estimated.count()) +
            static_cast<double>(task.idle_time_ns.load(kRelaxed));
        // Who waits for its own launches does not notice.
        if (run.measured.alone && task.factor.is_supported() && expected > 0 &&
            !sched::is_launch_bound(task))
            governor_.bystanders().measured(
                run.measured.most, nanoseconds(static_cast<std::int64_t>(expected)), run.position);
        run.measured.alone = false;
    }
    if (task.plan.is_empty())
        task.factor.observe_unknown(run.measured);
    else
        task.factor.observe(run.measured);
    const double factor = task.factor.value();
    task.slot->factor_ppm.store(model::to_ppm(factor), kRelaxed);
    const bool contradicts = factor > kContradicts || factor * kContradicts < 1;
    guard_.estimates_contradict(task.chain->index, contradicts && !task.plan.is_empty());
    task.gpu_time_ns.store(
        static_cast<std::int64_t>(factor * static_cast<double>(task.plan.gpu_time().count())),
        kRelaxed);
    if (run.measured.alone && run.launching.marks == 0) run.launching.marks = 1;  // none was needed
    task.contention.observe(run.launching, clock_.now());
    const double pace = task.contention.pace();
    if (std::abs(factor / task.reckoned_factor - 1) > kReckonBeyond ||
        std::abs(pace / task.reckoned_pace - 1) > kReckonBeyond) {
        task.plan.reckon_idle(factor, pace);
        task.reckoned_factor = factor;
        task.reckoned_pace = pace;
        task.idle_time_ns.store(task.plan.idle_from(0).count(), kRelaxed);
        governor_.plan().reckon_load();
    }
    publish_contention(task);
}

void Runtime::waited_to_launch(TaskState& task, const sched::Decision& decision, nanoseconds now) {
    // A loan ends holds for reasons of its own.
    if (!decision.launches_late && decision.rank != abi::kMaxTasks)
        task.contention.held(decision.others_pause, now);
    publish_contention(task);
}

void Runtime::publish_contention(TaskState& task) {
    if (task.stage == 0) {
        ChainStatistics& s = task.its_chain().statistics;
        s.launching.store(model::to_string(task.contention.verdict()), kRelaxed);
        s.launch_pace.store(task.contention.pace(), kRelaxed);
        s.slowdown.store(task.contention.slowdown(), kRelaxed);
    }
    const model::Launching verdict = task.contention.verdict();
    if (task.slot->launching.load(kRelaxed) == verdict) return;
    task.slot->launching.store(verdict, kRelaxed);
    governor_.plan().reckon_load();
}

/// What the task has not launched yet.
void Runtime::publish_head(TaskState& task) {
    task.slot->head_remaining_ns.store(still_to_launch(task).count(), kRelaxed);
    const nanoseconds idle =
        task.learning ? nanoseconds{0} : task.plan.idle_from(task.tracker.position());
    task.slot->head_idle_ns.store(idle.count(), kRelaxed);
}

}  // namespace urgengo::runtime
