// SPDX-License-Identifier: Apache-2.0
//
// From everybody's slots to a decision: what host/sched decides on, and how long it stands.
#include <algorithm>
#include <optional>

#include "host/base/own_time.h"
#include "host/runtime/runtime.h"
#include "host/sched/admission.h"
#include "host/sched/binding.h"
#include "host/sched/overdue.h"

namespace urgengo::runtime {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;
using abi::TaskSlot;
using model::SlotView;

/// How long a decision to let a task's launches go stands for the next ones.
constexpr nanoseconds kRemembered{20'000};
/// How long who is first stays so, while nobody comes or leaves and the plan is the same.
constexpr nanoseconds kFirstStands{2'000'000};
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

    const sched::Plan planned = plan(now, changes, task);
    const config::Scheduler& scheduler = scheduler_now(task);
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
        if (sched::look_after_overdue(scheduler_, snapshot, governor_.tasks()))
            governor_.tasks().changed();
    }
    if (!enforces(task)) decision->admit = decision->is_free = true;
    last = {changes, now, *decision, self.utilization};
    if (!decision->admit) last.time = -kRemembered;
    return *decision;
}

sched::Plan Runtime::plan(nanoseconds now, std::uint32_t& changes, const TaskState& maker) {
    const sched::StandingPlan::Answer answer = governor_.plan().plan(now, changes, maker);
    if (answer.was_made) governor_.plan().took(clock_.now() - now);
    return answer.plan;
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
        !self.overdue && scheduler_now(task).admission != config::Admission::kNone && enforces(task);
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
