// SPDX-License-Identifier: Apache-2.0
//
// Launches that need no question to the Governor. A task that is alone on the GPU, or comes before
// all others there, gets the same answer in the middle of a segment that goes as its profile says:
// go, at this priority, no mark yet. So that answer is given in advance, for the launches of the
// plan up to where a mark is due, the run-ahead is used up, or the segment ends.
// Each of them then costs a comparison with the plan and a few stores: a quarter of asking
// (docs/measurements.md). A task without a profile has no plan: all its kernels count as unknown
// ones, and any that is known to be loaded may go. It is compared with the last one, and written
// down where it is another.
//
// A task that launches more slowly than the GPU executes, and may go beside others that come first,
// is asked at every fifth launch (Governor::goes_without_a_look; some 25 us apart there). Only
// 14 % of the launches of seven traced networks went unasked before, and asking took 1 us of the
// 7 us of a launch (H100, 2026-11-28).
//
// Of a run that is not scheduled (the guard, sched/standing_aside.h, a task that did not fit) none
// is asked about that is as the plan says: what is to be known is where the program is. (Asked
// about, each took 270 ns of a launch of 6.5 us; seven traced networks, H200, 2026-11-28.)
//
// No other task asks whether the work of a slow program alone has executed. So such a program looks
// itself, and goes on (gpu_segments.cpp, must_have_executed).
//
// The Governor is asked again at the first launch that is not the plan's, is on another stream,
// asks for something of its own, comes behind an event that takes the time, or follows
//  - a change (SharedPage::changes): a task has entered or left the GPU, has been given up or taken
//    back, a capture has begun, a module is unloaded, UrgenGo is switched off; every end of a
//    segment, an instance or a hint is a change, too. After one a run that is not scheduled goes on
//    if it is the thread's still, no capture has begun and no module is unloaded;
//  - a pause in which the others stopped reckoning with the task;
//  - a call that makes another context current (ThreadState::ask_again).
//
// The owner alone counts these launches, in one number, and does not set `busy` for them. The
// thread that takes the task next, the owner or a helper, first catches up: it moves the tracker
// and the estimates on by that number. Other tasks read the slot, which is up to date at every
// launch. Only the times of the last launch and the last look of a task that was alone may be old:
// they are put right at its first launch after another task has come.
#include "host/runtime/planned_launches.h"

#include <algorithm>

#include "host/base/memory_orders.h"
#include "host/runtime/as_planned.h"
#include "host/runtime/estimates.h"

namespace urgengo::runtime {
namespace {

using abi::TaskSlot;

/// Of a launch-bound task that is not the first, after each launch that was asked about.
constexpr std::size_t kUnaskedBesideFirst = 4;

/// @returns how many unknown kernels may begin before they have taken `budget`
std::size_t num_unknown(nanoseconds budget) {
    const auto rounded_up = (budget + kUnknownKernel - nanoseconds{1}) / kUnknownKernel;
    return static_cast<std::size_t>(std::max<std::int64_t>(rounded_up, 0));
}

}  // namespace

// What no launch that goes unasked may be, and what each of them needs.
bool PlannedLaunches::may_go_unasked(const ThreadState& thread, const Launch& launch,
                                     const Grant& grant) const {
    return launch.function && !launch.asks_priority && !grant.may_be_timed && !grant.traced &&
           thread.task == grant.task && !grant.task->run.sync.waits && are_handles_good(thread);
}

bool PlannedLaunches::are_handles_good(const ThreadState& thread) const {
    return !common_.streams.captures().any() && thread.kernels.epoch == common_.kernels.epoch();
}

void PlannedLaunches::forget_old_functions(ThreadState& thread, TaskState& task) {
    if (task.unasked.functions_epoch == thread.kernels.epoch) return;
    task.plan.forget_functions();
    task.unasked.last = {};
    task.unasked.functions_epoch = thread.kernels.epoch;
}

void PlannedLaunches::allow(ThreadState& thread, const Launch& launch, const Grant& grant) {
    ThreadLine::AsPlanned& planned = thread.line.as_planned;
    thread.line.ask_again();
    // Before all that is looked at here: what changes after that is noticed at the next launch.
    planned.changes = common_.page().changes.load(std::memory_order_acquire);
    const bool alone = common_.governor.company().is_alone();
    if (!common_.follows_marks() || common_.marks_all() || !common_.governor.steered().decides() ||
        !may_go_unasked(thread, launch, grant))
        return;
    TaskState& task = *grant.task;
    if (!task.chain->may_be_scheduled()) return;
    const sched::GovernedRun& run = task.run;
    const bool by_launch =
        common_.scheduler.priority.via != config::PriorityVia::kStreamAttribute &&
        common_.scheduler.priority.via != config::PriorityVia::kStreamPool;
    if (!run.on_gpu || task.record.overlaps || !by_launch) return;
    forget_old_functions(thread, task);
    // What is learned is not what the plan says, and a span between marks teaches nothing if some
    // of its launches were estimated by the one and some by the other: shares would be wrong, and
    // wrong again at every repetition.
    if (task.learning) return;
    // Each launch in a fork is counted for its branch.
    if (!task.streams.graph.vouches() &&
        task.fork.is_followed(task.slot->marks_issued.load(kRelaxed)))
        return;
    const bool is_first = alone || common_.governor.decision_stands(task, grant.time);
    if (alone && run.mark.tells) return;
    if (!is_first &&
        (task.plan.is_empty() || !common_.governor.goes_without_a_look(task, grant.time)))
        return;

    planned.page = &common_.page();
    planned.slot = task.slot;
    planned.set_priority = grant.set_priority;
    planned.priority = static_cast<std::int16_t>(grant.priority);
    planned.is_watched = !alone;
    planned.is_observed = false;
    plan_ahead(thread, task, grant.time);
    if (!is_first) keep_small(planned, task.decision.utilization);
}

void PlannedLaunches::allow_observed(ThreadState& thread, const Launch& launch,
                                     const Grant& grant) {
    ThreadLine::AsPlanned& planned = thread.line.as_planned;
    thread.line.ask_again();
    planned.changes = common_.page().changes.load(std::memory_order_acquire);
    if (!may_go_unasked(thread, launch, grant) || grant.task->plan.is_empty()) return;
    forget_old_functions(thread, *grant.task);
    plan_observed(thread, *grant.task);
}

// Nothing is decided of them, and they are in no count of the task's work.
void PlannedLaunches::plan_observed(ThreadState& thread, TaskState& task) const {
    ThreadLine::AsPlanned& planned = thread.line.as_planned;
    const std::size_t position = task.tracker.position(), end = task.tracker.segment_end();
    if (common_.mode() == config::Mode::kOff || task.chain->is_switched_off() ||
        !task.tracker.in_segment() || position >= end)
        return;
    planned.page = &common_.page();
    planned.slot = task.slot;
    planned.set_priority = planned.is_watched = false;
    planned.has_plan = planned.is_observed = true;
    planned.kernel = &task.plan.at(position);
    task.unasked.from.store(static_cast<std::uint32_t>(position), kRelaxed);
    planned.left = static_cast<std::uint32_t>(end - position);
}

// After a change, which hardly ever is of a run that is not scheduled.
void PlannedLaunches::go_on_observed(ThreadState& thread) {
    ThreadLine::AsPlanned& planned = thread.line.as_planned;
    const model::PlannedKernel* const next = planned.kernel;
    const std::uint32_t changes = common_.page().changes.load(std::memory_order_acquire);
    if (!Runs::own_task(thread) || thread.task->slot != planned.slot) return;
    TaskState& task = *thread.task;
    if (!runs_.take(thread, task)) return;
    planned.left = 0;
    if (task.taking.owner.load(kRelaxed) == &thread && task.run.observed && !task.run.sync.waits &&
        !common_.tracer.is_on() && are_handles_good(thread) &&
        task.unasked.functions_epoch == thread.kernels.epoch)
        plan_observed(thread, task);
    if (planned.kernel != next) planned.left = 0;  // the run is another one
    if (planned.left != 0) planned.changes = changes;
    runs_.release(thread);
}

/// Few, and none that takes more of the GPU than was decided on.
void PlannedLaunches::keep_small(ThreadLine::AsPlanned& planned, double utilization) {
    const std::size_t most = std::min<std::size_t>(planned.left, kUnaskedBesideFirst);
    std::uint32_t left = 0;
    while (left < most && planned.kernel[left].utilization_ppm <= model::to_ppm(utilization))
        ++left;
    planned.left = left;
}

/// Beside a busy bystander some kernels are held and others are not. @returns where the first of
/// those is that are
std::size_t PlannedLaunches::before_held(const TaskState& task, std::size_t position,
                                         std::size_t end) const {
    const auto goes = [&](std::size_t at) {
        return common_.governor.bystanders().are_busy(
            task.plan.is_empty() ? kUnknownKernel : task.plan.at(at).gpu_time);
    };
    while (position != end && goes(position)) ++position;
    return position;
}

// As far as to where a mark is due, the run-ahead is used up, or the segment ends.
void PlannedLaunches::plan_ahead(ThreadState& thread, TaskState& task, nanoseconds now) {
    ThreadLine::AsPlanned& planned = thread.line.as_planned;
    const TaskSlot& slot = *task.slot;
    nanoseconds budget = segments_.mark_every(task, now) - (task.work.launched - task.work.looked);
    if (sched::is_paced(task, now)) {
        const std::uint32_t done = slot.marks_done.load(kRelaxed);
        const nanoseconds executed(slot.launched_at_mark_ns[done % abi::kMarkRing].load(kRelaxed));
        budget = std::min(budget, common_.governor.ahead().run_ahead.bound(task, now) -
                                      (task.work.launched - executed) + nanoseconds{1});
    }
    // What takes long is marked at once: it takes more than the budget, so it comes last.
    const nanoseconds longest = common_.governor.ahead().mark_spacing.long_unit(task);
    budget = std::min(budget, longest);
    const std::size_t position = task.tracker.position();
    std::size_t end = task.plan.is_empty()
                          ? position + num_unknown(budget)
                          : task.plan.reach(position, task.tracker.segment_end(), budget);
    // Among others, the mark comes right behind the launch at which it is due: that launch is
    // asked about.
    if (planned.is_watched && end > position) --end;
    const auto is_long = [&](const model::PlannedKernel& kernel) {
        return kernel.gpu_time >= longest;
    };
    if (!task.plan.is_empty() && end > position && is_long(task.plan.at(end - 1))) --end;
    if (planned.is_watched && common_.governor.bystanders().are_busy()) [[unlikely]]
        end = before_held(task, position, end);
    if (position == end) return;
    planned.has_plan = !task.plan.is_empty();
    planned.kernel = planned.has_plan ? &task.plan.at(position) : &task.unasked.last;
    task.unasked.from.store(static_cast<std::uint32_t>(position), kRelaxed);
    planned.left = static_cast<std::uint32_t>(end - position);
    planned.may_go_on = task.record.is_slow && !planned.is_watched;
}

// Another thread may have ended the run before the task was taken.
bool PlannedLaunches::is_at_work(const ThreadState& thread, const TaskState& task) {
    return task.taking.owner.load(kRelaxed) == &thread && task.run.on_gpu;
}

// Where a slow program alone would be asked, that is whether what it has launched has executed. If
// so, there is nothing else to be asked.
void PlannedLaunches::go_on(ThreadState& thread) {
    ThreadLine::AsPlanned& planned = thread.line.as_planned;
    planned.may_go_on = false;
    if (!Runs::own_task(thread) || thread.task->slot != planned.slot) return;
    TaskState& task = *thread.task;
    if (!runs_.take(thread, task)) return;
    const nanoseconds now = common_.clock.now();
    if (is_at_work(thread, task) && segments_.mark_is_due(task, now) &&
        segments_.must_have_executed(task, now)) {
        plan_ahead(thread, task, now);
        // An arriving task reckons with a task that gets on.
        planned.slot->launched_ns.store(task.work.launched.count(), kRelaxed);
        planned.slot->look_ns.store(now.count(), kRelaxed);
        planned.slot->launch_ns.store(now.count(), kRelaxed);
    }
    runs_.release(thread);
}

bool PlannedLaunches::goes(ThreadState& thread, const Launch& launch) {
    const ThreadLine::AsPlanned& planned = thread.line.as_planned;
    if (planned.left == 0 && !planned.may_go_on) return false;
    if (planned.is_observed && planned.page->changes.load(kRelaxed) != planned.changes)
        go_on_observed(thread);
    // If nothing has changed, the task is still this thread's, and its handles are good.
    const bool may_go = planned.page->changes.load(kRelaxed) == planned.changes &&
                        !launch.asks_priority && !launch.depends_on_previous &&
                        launch.stream == thread.line.stream && launch.flavor == thread.line.flavor;
    if (may_go) {
        if (planned.left == 0) go_on(thread);
        learn_function(thread, launch);
    }
    const bool goes = may_go &&
                      is_next_planned(thread.line, launch.function, launch.grid_blocks,
                                      launch.block_threads, launch.stream, launch.flavor) &&
                      (!planned.is_watched || is_reckoned_with(thread));
    if (!goes) {
        thread.line.ask_again();
        return false;
    }
    publish_next_planned(thread.line);
    return true;
}

// The plan knows names. Where its next one is launched by a handle for the first time, the thread
// knows that handle's. Without a plan, what comes is what was planned.
void PlannedLaunches::learn_function(ThreadState& thread, const Launch& launch) {
    if (thread.line.as_planned.left == 0) return;
    model::PlannedKernel& kernel = *thread.line.as_planned.kernel;
    const model::KernelKey size{0, launch.grid_blocks, launch.block_threads};
    const bool has_plan = thread.line.as_planned.has_plan;
    if (kernel.function == launch.function && (has_plan || kernel.key == size)) return;
    const identity::KnownKernel* known = thread.kernels.find(launch.function);
    if (!known || known->is_new || known->needs_room) return;  // that one is to be asked about
    if (!has_plan) {
        const double utilization = unknown_kernel(*thread.task, launch).utilization;
        kernel = {.key = size,
                  .gpu_time = kUnknownKernel,
                  .utilization_ppm = model::to_ppm(utilization),
                  .remaining = kUnknownKernel,
                  .function = launch.function};
    } else if (known->name_hash == kernel.key.name_hash) {
        kernel.function = launch.function;
    }
}

// Among others, the times of launches count.
bool PlannedLaunches::is_reckoned_with(const ThreadState& thread) {
    TaskSlot& slot = *thread.line.as_planned.slot;
    const nanoseconds now = common_.clock.now();
    if (now - nanoseconds(slot.look_ns.load(kRelaxed)) > model::kLaunchGrace) return false;
    slot.look_ns.store(now.count(), kRelaxed);
    slot.launch_ns.store(now.count(), kRelaxed);
    return true;
}

}  // namespace urgengo::runtime
