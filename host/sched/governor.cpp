// SPDX-License-Identifier: Apache-2.0
//
// How long decisions stand: a decision that let a task's launch go, for 20 us and launches that
// take no more of the GPU; that of a launch-bound task for 100 us without a look, and a few
// launches more (runtime/planned_launches.cpp), as looks are a tenth of what launching takes beside
// others (seven traced networks, H100: 0.56 looks of 1.9 us for each launch of 6 us); the decision
// that a task is first, for 2 ms while no task comes to the GPU or leaves it and the plan is the
// same.
#include "host/sched/governor.h"

#include <algorithm>

#include "host/base/memory_orders.h"
#include "host/base/own_time.h"
#include "host/config/task_count.h"
#include "host/model/starvation.h"
#include "host/model/task_reading.h"
#include "host/sched/admission.h"
#include "host/sched/binding.h"
#include "host/sched/copies.h"
#include "host/sched/overdue.h"

namespace urgengo::sched {
namespace {

using abi::TaskSlot;

constexpr nanoseconds kRemembered{20'000}, kRememberedSlow{100'000};
constexpr nanoseconds kFirstStands{2'000'000};
constexpr nanoseconds kNever{-1'000'000'000};
/// Beside a busy bystander turns at launching are taken by tasks that others slow down by so much.
/// (H100, 2026-11-26: eager networks of one process by 2 to 10, traced ones by 1.1 to 1.5.)
constexpr double kTurnsBesideBystander = 2;

config::Scheduler without_holds(config::Scheduler scheduler) {
    scheduler.admission = config::Admission::kNone;
    return scheduler;
}

bool has_standing_keys(const config::Scheduler& s) {
    using config::Policy;
    return s.admission == config::Admission::kPacked &&
           (s.policy == Policy::kFeasible || s.policy == Policy::kEdf ||
            s.policy == Policy::kStatic || s.policy == Policy::kFifo);
}

/// One a task, and each chain's next one.
std::size_t most_instances(const std::vector<config::Chain>& chains) {
    return chains.size() + config::num_tasks(chains);
}

}  // namespace

Governor::Governor(const config::Scheduler& scheduler, const std::vector<config::Chain>& chains,
                   config::Mode mode, abi::SharedPage& page, ProgressListener& listener,
                   nanoseconds start)
    : scheduler_(scheduler),
      priorities_alone_(without_holds(scheduler)),
      follows_urgencies_(scheduler.binding == config::Binding::kTask ||
                         scheduler.admission == config::Admission::kThreshold),
      keys_stand_(has_standing_keys(scheduler)),
      page_(page),
      steered_(mode),
      tasks_(scheduler_, page, listener),
      company_(page, chains, start),
      ahead_(scheduler_, tasks_, company_),
      plan_(scheduler_, tasks_, most_instances(chains)),
      aside_(scheduler_, tasks_),
      urgent_threshold_(scheduler.parameters.urgent_percentile),
      estimates_(scheduler_, tasks_, company_, bystanders_, plan_),
      queue_(page),
      polls_(scheduler.hold.poll) {}

// --- told

void Governor::comes_to_gpu(const GovernedTask& task, nanoseconds now) {
    page_.on_gpu.fetch_add(1, kRelaxed);
    company_.came(task.chain->index, now);
    tasks_.changed();
}

void Governor::leaves_gpu(GovernedTask& task, nanoseconds now) {
    ahead_.lead.over(task);
    company_.note(now);
    page_.on_gpu.fetch_sub(1, kRelaxed);
    tasks_.changed();
}

void Governor::look_for_bystanders(nanoseconds now) {
    if (bystanders_.look(now)) tasks_.changed();
}

void Governor::sleeps(GovernedTask& task, const Wait& wait) {
    task.run.pace.no_gap();  // behind a gate it does not
    queue_.stands({.task = task.index,
                   .why = wait.why,
                   .behind = wait.behind,
                   .since = nanoseconds(task.slot->look_ns.load(kRelaxed)),
                   .key = wait.key});
}

void Governor::slept(GovernedTask& task, const Wait& wait, nanoseconds time, nanoseconds now) {
    GovernedRun& run = task.run;
    if (wait.is_paced) {
        run.pace.gap_since = now - time + wait.sleep;
        task.record.gaps.slept(wait.sleep);
        run.waited.paced += time;
    } else {
        run.waited.held += time;
        if (!wait.has_work) run.waited.held_idle += time;
        model::gave_way(*task.slot, time);
    }
    queue_.waited(now);
}

void Governor::looked(const GovernedTask& task, Answer& answer, nanoseconds begin,
                      nanoseconds end) {
    polls_.looked(begin, end);
    if (polls_.is_over(begin)) answer.wait.reset();
    if (answer.wait)
        answer.wait->sleep = rest(task, answer);
    else
        queue_.leaves(task.index);
}

// --- asked

bool Governor::stands_aside(nanoseconds now) {
    if (aside_.is_on()) look_for_bystanders(now);  // no launch does
    if (aside_.is_due(now)) aside_.look(bystanders_.are_busy(), now);
    return aside_.is_on() && steered_.enforces();
}

bool Governor::schedules() const {
    return steered_.decides() && (scheduler_.admission != config::Admission::kNone ||
                                  scheduler_.binding != config::Binding::kNone);
}

nanoseconds Governor::hold_bound(const GovernedTask& task) const {
    if (scheduler_.hold.max_per_instance.count() > 0) return scheduler_.hold.max_per_instance;
    const auto deadline = static_cast<double>(task.chain->deadline().count());
    return nanoseconds(static_cast<std::int64_t>(deadline * scheduler_.hold.max_deadlines));
}

bool Governor::decision_stands(const GovernedTask& task, nanoseconds now) const {
    const RememberedDecision& last = task.decision;
    return keys_stand_ && last.decision.admit && last.decision.is_free &&
           now - last.time < kFirstStands && last.changes == tasks_.changes() &&
           !plan_.is_due(last.changes, now);
}

/// Of a launch that takes no more of the GPU, beside the same tasks.
bool Governor::decision_is_remembered(const GovernedTask& task, double utilization,
                                      nanoseconds time, nanoseconds now) const {
    const RememberedDecision& last = task.decision;
    return now - last.time < time && last.changes == tasks_.changes() &&
           utilization <= last.utilization && scheduler_.admission != config::Admission::kExclusive;
}

/// Its launches take so long that looks are worth sparing. Not of one that takes the GPU for long.
bool Governor::goes_without_a_look(const GovernedTask& task, nanoseconds now) const {
    return keys_stand_ && !follows_urgencies_ && is_launch_bound(task) &&
           task.run.next.count() < kWorthHolding_ns &&
           decision_is_remembered(task, 1e-6 * task.slot->head_utilization_ppm.load(kRelaxed),
                                  kRememberedSlow, now);
}

// As far as the last look knew: the GPU is further by now. A task that has done nothing for a while
// asks anew.
std::optional<Decision> Governor::goes_as_before(GovernedTask& task, nanoseconds now) {
    if (follows_urgencies_) [[unlikely]] {
        record_urgency(now);
        return std::nullopt;
    }
    const bool alone = company_.is_alone();
    if (!alone && is_long_beside_bystander(task)) return std::nullopt;
    if (is_paced(task, now) && !ahead_.run_ahead.is_within(task, now)) return std::nullopt;
    std::atomic<std::int64_t>& look_ns = task.slot->look_ns;
    const bool paused = now - nanoseconds(look_ns.load(kRelaxed)) > model::kLaunchGrace;
    if (!alone && (paused || !(decision_stands(task, now) || goes_without_a_look(task, now))))
        return std::nullopt;
    look_ns.store(now.count(), kRelaxed);
    return alone ? Decision{} : task.decision.decision;
}

// An instance that has been held for its bound is held for others no more; its own run-ahead still
// paces it, and its rank still gives it a low priority. What is not marked cannot be seen to end: a
// task that has forked is not paced unless its branches are marked.
Answer Governor::ask(GovernedTask& task, const Request& request, nanoseconds now) {
    Answer answer;
    bool is_marked = false, has_work = false;
    const bool within = look(task, request, answer, is_marked, has_work, now);
    const Decision& d = answer.decision;
    const GovernedRun& run = task.run;
    const nanoseconds bound = hold_bound(task);
    const bool is_held = !d.admit && run.waited.held < bound;
    const bool is_paced =
        !within && run.waited.paced < bound && (request.is_seen || fork_tells(task));
    if ((!is_held && !is_paced) || polls_.is_over(now)) {
        queue_.leaves(task.index);
        return answer;
    }
    // What is launched must be visible while it waits: to the others, and to its own run-ahead,
    // which a mark that is under way tells enough.
    answer.wait = {.why = is_held ? d.why : Why::kRunAhead,
                   .behind = is_held ? d.blocker : -1,
                   .key = d.key,
                   .is_paced = !is_held,
                   .wants_mark = task.work.launched != task.work.marked && !(d.admit && is_marked),
                   .has_work = has_work};
    answer.wait->sleep = rest(task, answer);
    return answer;
}

nanoseconds Governor::rest(const GovernedTask& task, const Answer& answer) const {
    const nanoseconds bound = hold_bound(task);
    if (answer.wait->is_paced) return polls_.rest_paced(bound - task.run.waited.paced);
    const int place = queue_.place(task.index, answer.decision.key);
    const nanoseconds most = bound - task.run.waited.held;
    return answer.wait->why == Why::kTurnToLaunch ? polls_.rest_for_turn(place, most)
                                                  : polls_.rest(place, most);
}

void Governor::look_at_fork(GovernedTask& task) const {
    if (!task.fork.is_there()) [[likely]]
        return;
    const std::uint32_t done = task.slot->marks_done.load(kRelaxed);
    const nanoseconds executed = task.fork.executed(*task.line.load(kRelaxed), done);
    task.fork_executed.store(executed, done);
    task.fork.looked(task.executed() + executed, task.run.waited.paced,
                     model::patience_for(scheduler_.run_ahead.limit));
}

// Once nothing is under way that tells more, the task is not paced: the GPU may have no work of it.
bool Governor::fork_tells(const GovernedTask& task) {
    const std::uint32_t issued = task.slot->marks_issued.load(kRelaxed);
    return task.fork.is_followed(issued) && (task.slot->marks_done.load(kRelaxed) != issued ||
                                             task.fork.is_marked(*task.line.load(kRelaxed)));
}

bool Governor::look(GovernedTask& task, const Request& request, Answer& answer, bool& is_marked,
                    bool& has_work, nanoseconds now) {
    const own_time::Deciding deciding;
    TaskSlot& slot = *task.slot;
    // A task that has done nothing for a while was no blocker, and is one again.
    const bool is_held = state_of(task) == abi::TaskState::kHeld;
    if (!is_held && now - nanoseconds(slot.look_ns.load(kRelaxed)) > model::kLaunchGrace)
        tasks_.changed();
    GovernedRun::Pace& pace = task.run.pace;
    if (pace.gap_since != GovernedRun::Pace::kNoGap) {
        task.record.gaps.passed(now - pace.gap_since, scheduler_.run_ahead.limit, now);
        pace.gap_since = now;
    }
    slot.look_ns.store(now.count(), kRelaxed);
    pace.looked_at = now;
    look_for_bystanders(now);
    SlotView self = tasks_.look(task, now);
    look_at_fork(task);
    self.next = task.run.next;
    is_marked = self.ahead.pending;
    has_work = self.ahead.launched.count() > 0;
    answer.decision = decide(task, self, request.enforces, answer, now);
    // What waits for something other than the GPU may be waiting for this very launch.
    pace.is_bounded = !self.state.overdue &&
                      scheduler_now(task, self).admission != config::Admission::kNone &&
                      request.enforces;
    // Two kernels may always be queued: the GPU never waits for our poll between them.
    bool within = ahead_.run_ahead.is_within(task, now) || task.queued() < 2 || !pace.is_bounded;
    if (!answer.decision.admit || !within) lend(task, self, answer, within, now);
    return within;
}

// What the others want changes with their progress; but a decision to let a launch go is remembered
// for a moment, while no task comes to the GPU or leaves it, for launches that take no more of it.
Decision Governor::decide(GovernedTask& task, const SlotView& self, bool enforces, Answer& answer,
                          nanoseconds now) {
    if (company_.is_alone() && !follows_urgencies_) return {};
    RememberedDecision& last = task.decision;
    const bool is_like_others = !is_long_beside_bystander(task);
    if (is_like_others && decision_stands(task, now)) return last.decision;
    // Before the looks that it vouches for.
    std::uint32_t changes = tasks_.changes(std::memory_order_acquire);
    if (is_like_others && decision_is_remembered(task, self.utilization, kRemembered, now))
        return last.decision;

    const auto [planned, was_made] = plan_.plan(now, changes, task);
    answer.has_made_plan = was_made;
    const config::Scheduler& scheduler = scheduler_now(task, self);
    std::vector<SlotView>& views = task.views;
    views.assign(1, self);
    tasks_.for_each_active([&](GovernedTask& other) {
        if (&other == &task || !may_be_on_gpu(other)) return;
        const SlotView view = tasks_.look(other, now);
        if (view.state.ranked) views.push_back(view);
    });
    if (bystanders_.are_busy())
        for (SlotView& view : views) view.longer_beside = estimates_.longer_beside(view);
    Snapshot snapshot{now,
                      views,
                      planned,
                      urgent_threshold_.laxity(),
                      static_cast<int>(tasks_.chains().size()),
                      num_levels(task)};
    snapshot.takes_turns = scheduler_.admission == config::Admission::kPacked &&
                           task.record.contention.verdict() == model::Launching::kSlowed &&
                           task.record.contention.slowdown() >= kTurnsBesideBystander;
    Decision decision = sched::decide(scheduler, snapshot);
    if (look_after_overdue(scheduler_, snapshot, tasks_)) tasks_.changed();
    if (!enforces) decision.admit = decision.is_free = true;
    last = {changes, now, decision, self.utilization};
    if (!decision.admit) last.time = kNever;
    return decision;
}

bool Governor::looks_instead_of_mark(GovernedTask& task, nanoseconds now) {
    if (!ahead_.mark_spacing.is_spared(task, plan_.launching_is_scarce())) return false;
    estimates_.sees_launchers(task, now);
    task.work.looked = task.work.launched;
    return true;
}

// The launch that would have to wait goes: if it was held, behind all others.
void Governor::lend(GovernedTask& task, const SlotView& self, Answer& answer, bool& within,
                    nanoseconds now) {
    const bool is_in_fork = task.fork.is_followed(task.slot->marks_issued.load(kRelaxed));
    answer.loan =
        lend_urgency(scheduler_, tasks_, task, answer.decision.admit, answer.decision.rank,
                     ahead_.run_ahead.reach(task, is_in_fork), plan_.gives_up(task), now);
    if (answer.loan == Loan::kNone) return;
    task.lead.is_lent = answer.loan == Loan::kToLead;
    if (is_in_fork) task.record.lent_forks.lent(task.slot->instance.load(kRelaxed), now);
    if (answer.loan == Loan::kToHeld) answer.decision = behind_all(self);
    within = true;
    task.decision.time = kNever;  // of this launch alone
}

// The highest urgency among the tasks on the GPU.
void Governor::record_urgency(nanoseconds now) {
    if (!urgent_threshold_.is_due(now)) return;
    nanoseconds least = nanoseconds::max();
    tasks_.for_each_active([&](GovernedTask& task) {
        if (!may_be_on_gpu(task)) return;
        const SlotView view = tasks_.look(task, now);
        if (view.state.ranked && view.laxity.count() >= 0) least = std::min(least, view.laxity);
    });
    if (least != nanoseconds::max()) urgent_threshold_.record(least);
}

int Governor::num_levels(const GovernedTask& task) const {
    return sched::num_levels(scheduler_.priority.levels, task.run.priority.least,
                             task.run.priority.greatest);
}

Levels Governor::levels(GovernedTask& task, bool is_vouched, const Decision& decision,
                        nanoseconds now) {
    const int levels = num_levels(task);
    const auto rank = static_cast<int>(task.slot->static_rank.load(kRelaxed));
    const int bucket = bucket_of(rank, static_cast<int>(tasks_.chains().size()), levels);
    const int wanted = task.run.priority.level >= 0
                           ? task.run.priority.level
                           : level_of(scheduler_.binding, decision, bucket, levels);
    const Levels may =
        ahead_.lead.levels(task, is_vouched, decision, wanted, levels, bystanders_.are_busy(), now);
    // Bound for the rest of the task.
    if (scheduler_.binding == config::Binding::kTask) task.run.priority.level = may.level;
    return may;
}

bool Governor::copy_waits(GovernedTask& task, std::span<const bool> at_engine, Answer& answer,
                          nanoseconds now) {
    std::vector<SlotView>& views = task.views;
    views.clear();
    std::array<bool, abi::kMaxTasks> unfinished{};
    const auto add = [&](GovernedTask& other) {
        const SlotView view = tasks_.look(other, now);
        if (!view.state.active) return false;
        unfinished[views.size()] = at_engine[static_cast<std::size_t>(other.index)];
        views.push_back(view);
        return true;
    };
    if (!add(task)) return false;
    tasks_.for_each_active([&](GovernedTask& other) {
        if (&other != &task) add(other);
    });
    std::uint32_t changes = tasks_.changes(std::memory_order_acquire);
    const auto [planned, was_made] = plan_.plan(now, changes, task);
    answer.has_made_plan = was_made;
    return copy_must_wait(scheduler_,
                          {now, views, planned, urgent_threshold_.laxity(),
                           static_cast<int>(tasks_.chains().size()), num_levels(task)},
                          {unfinished.data(), views.size()});
}

}  // namespace urgengo::sched
