// SPDX-License-Identifier: Apache-2.0
//
// From everybody's slots to a decision: what host/sched decides on, and how long it stands.
#include <algorithm>
#include <optional>

#include "host/base/own_time.h"
#include "host/runtime/runtime.h"
#include "host/sched/admission.h"
#include "host/sched/binding.h"
#include "host/sched/criticality.h"
#include "host/sched/policies/feasible.h"

namespace urgengo::runtime {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
using abi::TaskSlot;
using model::SlotView;

/// How long a decision to let a task's launches go stands for the next ones.
constexpr nanoseconds kRemembered{20'000};
/// How long who is first stays so, while nobody comes or leaves and the plan is the same.
constexpr nanoseconds kFirstStands{2'000'000};
/// How long a plan stands, while nobody comes to the GPU or leaves it.
constexpr nanoseconds kPlanStands{200'000};
/// And whoever comes or leaves, where there is plenty of time: so much less of it does not matter.
/// Until a plan is needed (Runtime::plan_is_needed).
constexpr nanoseconds kPlanOfPlentyStands{10'000'000};

/// What took longer to plan stands for so many times as long, whoever comes or leaves: of hundreds
/// of tasks somebody always does.
constexpr nanoseconds kDearPlan{20'000};
constexpr int kDearPlanStands = 5;

/// Overdue work is passed over for so long before others give way to it.
constexpr nanoseconds kPassedOver{10'000'000};
/// They do for so much of the time that it has waited, at least: a sixteenth.
constexpr int kDrainShare = 16;

/// Frames that should arrive within this time are planned for.
constexpr nanoseconds kHorizon{60'000'000};
/// A chain that is so many periods late has stopped.
constexpr int kStopped = 2;

bool is_idle(const sched::GovernedTask& task) {
    return task.slot->state.load(kRelaxed) == abi::TaskState::kIdle;
}

/// What is read of the others' slots is on its way at once: most comes from the caches of the cores
/// that wrote it.
void prefetch(const sched::GovernedTask& task) {
    if (is_idle(task)) return;
    const char* slot = reinterpret_cast<const char*>(task.slot);
    __builtin_prefetch(slot + offsetof(TaskSlot, marks_issued));
    __builtin_prefetch(slot + offsetof(TaskSlot, marks_done));
    __builtin_prefetch(slot + offsetof(TaskSlot, relative_deadline_ns));
    __builtin_prefetch(task.line.load(kRelaxed));
    __builtin_prefetch(&task.pending_ns);
}

}  // namespace

// Who is first stays so until somebody comes to the GPU or leaves it, or somebody is given up or
// taken back; at least under the policies whose keys are deadlines.
bool Runtime::decision_stands(const TaskState& task, nanoseconds now) const {
    const sched::RememberedDecision& last = task.decision;
    return keys_stand_ && last.decision.admit && last.decision.is_free &&
           now - last.time < kFirstStands && last.changes == page_->changes.load(kRelaxed);
}

// Who has done nothing for a while asks anew.
bool Runtime::is_still_free(const TaskState& task, nanoseconds now) const {
    const nanoseconds last_look(task.slot->look_ns.load(kRelaxed));
    return now - last_look <= model::kLaunchGrace && decision_stands(task, now);
}

// As far as the last look knew: the GPU is further by now.
bool Runtime::may_run_ahead(const TaskState& task, nanoseconds now) const {
    return !sched::is_paced(task, now) || governor_.run_ahead().is_within(task, now);
}

// What the others want changes with their progress; but a decision to let a launch go is remembered
// for a moment, while nobody came to the GPU or left it, for launches that take no more of the GPU.
sched::Decision Runtime::decide(TaskState& task, const SlotView& self, nanoseconds now) {
    if (governor_.company().is_alone() && !follows_urgencies_) return {};
    sched::RememberedDecision& last = task.decision;
    if (decision_stands(task, now)) return last.decision;
    // Before the looks that it vouches for.
    std::uint32_t changes = page_->changes.load(std::memory_order_acquire);
    if (last.changes == changes && now - last.time < kRemembered &&
        self.utilization <= last.utilization &&
        scheduler_.admission != config::Admission::kExclusive)
        return last.decision;

    const sched::Plan planned = plan(now, changes);
    const config::Scheduler& scheduler = scheduler_now();
    auto decision = sched::decide_at_leisure(scheduler, self, planned);
    if (!decision) {
        std::vector<SlotView>& views = task.views;
        views.assign(1, self);
        governor_.tasks().for_each_active([&](sched::GovernedTask& other) {
            if (&other == &task || !sched::may_be_on_gpu(other)) return;
            const SlotView view = governor_.tasks().look(other, now);
            if (view.ranked) views.push_back(view);
        });
        const sched::Snapshot snapshot{now,
                                       views,
                                       planned,
                                       urgent_threshold_.laxity(),
                                       static_cast<int>(chains_.size()),
                                       num_levels(task)};
        decision = sched::decide(scheduler, snapshot);
        look_after_the_overdue(snapshot);
    }
    if (!enforces(task)) decision->admit = decision->is_free = true;
    last = {changes, now, *decision, self.utilization};
    if (!decision->admit) last.time = -kRemembered;
    return *decision;
}

// Overdue work mostly waits for something that is not the GPU. But it may have been launched at a
// low priority and be urgent now: then it is behind all that others launch, for as long as they do.
// So who passes over it lets it have the GPU now and then: until what the others have there is
// done and it has had its time; the more seldom, the longer it was of no use. How long the others'
// takes is not known of a kernel without a profile, so the bound is generous; that they have
// nothing there any more is seen.
bool Runtime::clear_the_way(const SlotView& overdue, nanoseconds drained, nanoseconds now) {
    std::atomic<std::int64_t>& cleared_until_ns =
        tasks_[static_cast<std::size_t>(overdue.task)]->slot->cleared_until_ns;
    std::int64_t last = cleared_until_ns.load(kRelaxed);
    const nanoseconds waited_then = nanoseconds(last) - (now - overdue.waited);
    if (overdue.waited < std::max(kPassedOver, 2 * waited_then)) return false;
    // Unknown work is drained later than it should be.
    const nanoseconds until =
        now + overdue.patience + std::max(drained, overdue.waited / kDrainShare);
    return cleared_until_ns.compare_exchange_strong(last, until.count(), kRelaxed);
}

void Runtime::way_is_clear(const SlotView& overdue, nanoseconds now) {
    std::atomic<std::int64_t>& cleared_until_ns =
        tasks_[static_cast<std::size_t>(overdue.task)]->slot->cleared_until_ns;
    const std::int64_t until = (now + overdue.patience).count();
    std::int64_t last = cleared_until_ns.load(kRelaxed);
    if (until < last) cleared_until_ns.compare_exchange_strong(last, until, kRelaxed);
}

void Runtime::look_after_the_overdue(const sched::Snapshot& snapshot) {
    const auto is_let_by = [](const SlotView& v) { return v.overdue && !v.blocking; };
    const auto is_at_work = [](const SlotView& v) { return !v.overdue && v.launched.count() > 0; };
    if (std::none_of(snapshot.tasks.begin(), snapshot.tasks.end(), is_at_work))
        for (const SlotView& v : snapshot.tasks)
            if (v.overdue && v.blocking) way_is_clear(v, snapshot.now);
    if (std::none_of(snapshot.tasks.begin(), snapshot.tasks.end(), is_let_by)) return;
    const sched::TaskSet slots = sched::passed_over(scheduler_, snapshot);
    nanoseconds drained{0};
    for (const SlotView& v : snapshot.tasks) drained += v.launched;
    bool cleared = false;
    for (const SlotView& v : snapshot.tasks)
        if (slots.contains(v.task)) cleared |= clear_the_way(v, drained - v.launched, snapshot.now);
    if (cleared) governor_.tasks().changed();
}

// The chain's next frame, a period after its last one.
std::optional<SlotView> Runtime::expected(const sched::GovernedChain& chain,
                                          nanoseconds now) const {
    const nanoseconds last(chain.last_arrival_ns.load(kRelaxed));
    const nanoseconds arrival = last + chain.config.period;
    if (last.count() == 0 || arrival > now + kHorizon ||
        now > last + kStopped * chain.config.period)
        return std::nullopt;
    const TaskState& first = *tasks_[static_cast<std::size_t>(chain.tasks.front())];
    const TaskSlot& slot = *first.slot;
    const nanoseconds cpu(first.cpu_time_ns.load(kRelaxed)), gpu(first.gpu_time_ns.load(kRelaxed));
    const nanoseconds idle(first.idle_time_ns.load(kRelaxed));
    SlotView view;
    view.task = SlotView::kExpected;
    view.deadline = std::max(arrival, now) + chain.config.deadline;
    view.period = chain.config.period;
    view.release = std::max(arrival, now) + cpu;
    view.remaining_gpu = nanoseconds(slot.chain_gpu_ns.load(kRelaxed));
    view.later_gpu = view.remaining_gpu - gpu;
    view.remaining_idle = nanoseconds(slot.chain_idle_ns.load(kRelaxed));
    view.later_idle = view.remaining_idle - idle;
    view.later_cpu = nanoseconds(slot.chain_cpu_ns.load(kRelaxed)) - cpu;
    view.remaining_cpu = view.later_cpu + cpu;
    view.is_supported = slot.is_supported.load(kRelaxed) != 0;
    view.launching = static_cast<model::Launching>(slot.launching.load(kRelaxed));
    view.launch_share = governor_.tasks().launch_share(view.launching);
    view.laxity =
        model::laxity({view.deadline, view.remaining_gpu + view.remaining_idle, view.remaining_cpu},
                      std::max(arrival, now));
    view.criticality = sched::criticality(chain);
    return view;
}

// What a plan was made for is read before the plan.
std::optional<sched::Plan> Runtime::standing_plan(nanoseconds now, std::uint32_t changes,
                                                  std::uint32_t needed) const {
    const nanoseconds age = now - plan_.time.load(kRelaxed);
    const bool is_of_now = plan_.changes.load(std::memory_order_acquire) == changes;
    const bool is_enough = plan_.made_for.load(std::memory_order_acquire) == needed;
    const sched::Plan last = plan_.read();
    const bool is_plenty =
        last.given_up.is_empty() && last.slack >= std::max(sched::kPlenty, scheduler_.share_slack);
    if (is_of_now && age < kPlanStands) return last;
    if (is_enough && is_plenty && age < kPlanOfPlentyStands) return last;
    return std::nullopt;
}

// One thread plans for all; the others go by what was planned last. Somebody given up, or taken
// back, is a change.
sched::Plan Runtime::plan(nanoseconds now, std::uint32_t& changes) {
    if (scheduler_.policy != config::Policy::kFeasible) return {};
    const std::uint32_t needed = plan_.needed.load(std::memory_order_acquire);
    if (const auto last = standing_plan(now, changes, needed)) return *last;
    const nanoseconds cost = plan_.cost.load(kRelaxed);
    const bool is_dear =
        cost > kDearPlan && now - plan_.time.load(kRelaxed) < kDearPlanStands * cost;
    if (is_dear || !plan_.take()) {
        changes = plan_.changes.load(std::memory_order_acquire);  // of what there is
        return plan_.read();
    }
    std::vector<SlotView>& views = plan_.views;
    views.clear();
    bool is_complete = true;
    governor_.tasks().for_each_active([](sched::GovernedTask& task) { prefetch(task); });
    governor_.tasks().for_each_active([&](sched::GovernedTask& task) {
        if (is_idle(task)) return;
        const SlotView view = governor_.tasks().look(task, now);
        if (view.active)
            views.push_back(view);
        else
            is_complete = false;  // it was being written
    });
    for (const auto& chain : chains_)
        if (const auto view = expected(*chain, now)) views.push_back(*view);
    const sched::Plan plan =
        sched::make_plan(now, views, scheduler_.plan_margin, scheduler_.share_slack, plan_.scratch,
                         load_.load(kRelaxed));
    plan_.may_share.store(plan.may_share);
    plan_.slack.store(plan.slack, kRelaxed);
    const bool is_other =
        plan_.given_up.load() != plan.given_up || plan_.late_first.load() != plan.late_first;
    plan_.given_up.store(plan.given_up);
    plan_.late_first.store(plan.late_first);
    if (is_other && page_->changes.fetch_add(1, std::memory_order_release) == changes) ++changes;
    plan_.time.store(now, kRelaxed);
    // A core that was lost meanwhile is no cost of a plan.
    plan_.cost.store(std::min(clock_.now() - now, 10 * kDearPlan), kRelaxed);
    plan_.made_for.store(is_complete ? needed : needed - 1, std::memory_order_release);
    plan_.changes.store(changes, std::memory_order_release);
    plan_.release();
    return plan;
}

// The highest urgency among the tasks on the GPU.
void Runtime::record_urgency(nanoseconds now) {
    if (!urgent_threshold_.is_due(now)) return;
    nanoseconds least = nanoseconds::max();
    governor_.tasks().for_each_active([&](sched::GovernedTask& task) {
        if (!sched::may_be_on_gpu(task)) return;
        const SlotView view = governor_.tasks().look(task, now);
        if (view.ranked && view.laxity.count() >= 0) least = std::min(least, view.laxity);
    });
    if (least != nanoseconds::max()) urgent_threshold_.record(least);
}

void Runtime::look_for_bystanders(nanoseconds now) {
    if (!bystanders_.window_ended(now)) return;
    const bool launched = bystander_launched_->load(kRelaxed);
    if (launched) bystander_launched_->store(false, kRelaxed);
    if (bystanders_.saw(launched)) governor_.tasks().changed();
}

Runtime::Look Runtime::look(TaskState& task, nanoseconds now) {
    const own_time::Deciding deciding;
    TaskSlot& slot = *task.slot;
    // Who has done nothing for a while was not in the others' way, and is again.
    const bool is_held = slot.state.load(kRelaxed) == abi::TaskState::kHeld;
    if (!is_held && now - nanoseconds(slot.look_ns.load(kRelaxed)) > model::kLaunchGrace)
        comes_to_gpu(task);
    slot.look_ns.store(now.count(), kRelaxed);
    task.run.looked_at = now;
    look_for_bystanders(now);
    SlotView self = governor_.tasks().look(task, now);
    self.next = task.run.next;
    if (task.learning) [[unlikely]]
        learn(task);

    Look result;
    result.is_marked = self.pending;
    result.has_work = self.launched.count() > 0;
    result.decision = decide(task, self, now);
    // Two kernels may always be queued: the GPU never waits for our poll between them.
    const std::uint32_t done = slot.marks_done.load(kRelaxed);
    const std::uint32_t queued =
        task.run.position - task.run.position_at_mark[done % abi::kMarkRing];
    // And what waits for something other than the GPU may be waiting for this very launch.
    task.run.is_paced =
        !self.overdue && scheduler_now().admission != config::Admission::kNone && enforces(task);
    result.within_run_ahead =
        governor_.run_ahead().is_within(task, now) || queued < 2 || !task.run.is_paced;
    lend_urgency(task, self, result, now);
    return result;
}

int Runtime::num_levels(const TaskState& task) const {
    return sched::num_levels(scheduler_.priority_levels, task.run.least_priority,
                             task.run.greatest_priority);
}

// What the program asks for is a wish among its own launches: one level more urgent than the rest
// of its task, not before tasks that are more urgent by more than that.
int Runtime::priority_for(TaskState& task, const Launch& launch, const sched::Decision& decision,
                          nanoseconds now) {
    sched::GovernedRun& run = task.run;
    TrackedRun& tracked = task.tracked;
    const int least = run.least_priority, greatest = run.greatest_priority;
    const int levels = num_levels(task);
    const auto rank = static_cast<int>(task.slot->static_rank.load(kRelaxed));
    int level = run.level;
    if (level < 0)
        level = sched::level_of(scheduler_.binding, decision,
                                sched::bucket_of(rank, static_cast<int>(chains_.size()), levels),
                                levels);
    const bool is_vouched = !follows_marks() || task.graph.vouches();
    const sched::Levels may = governor_.lead().levels(task, is_vouched, decision, level, levels,
                                                      bystanders_.are_busy(), now);
    level = may.level;
    // Bound for the rest of the task.
    if (scheduler_.binding == config::Binding::kTask) run.level = level;
    const int asked = launch.asks_priority                     ? launch.priority
                      : exec::is_default_stream(launch.stream) ? 0
                                                               : tracked.stream_priority;
    const int priority = greatest + level;
    return asked < least ? std::max(priority - 1, greatest + may.first) : priority;
}

}  // namespace urgengo::runtime
