// SPDX-License-Identifier: Apache-2.0
//
// Urgency is lent: a task that is held goes while a more urgent one does not come, which may be
// waiting for a lock that the held thread has (sched/absence.h). Asked when a launch would
// have to wait, and at each poll then.
#include "host/model/lent_deadline.h"
#include "host/runtime/runtime.h"
#include "host/sched/admission.h"

namespace urgengo::runtime {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;

}  // namespace

bool Runtime::is_absent(const ChainState& chain, nanoseconds held_deadline, nanoseconds now,
                        nanoseconds later) const {
    const sched::GovernedTask& first = *tasks_[static_cast<std::size_t>(chain.tasks.front())];
    const bool is_at_work = first.slot->state.load(kRelaxed) != abi::TaskState::kIdle;
    if (is_at_work) return false;
    const nanoseconds cpu(first.cpu_time_ns.load(kRelaxed));
    const auto awaited = chain.expectation.awaited(chain.config.period, chain.config.deadline, cpu);
    return awaited && sched::is_lent(*awaited, held_deadline, now - later);
}

bool Runtime::has_stalled(TaskState& task, nanoseconds held_deadline, nanoseconds now,
                          nanoseconds later) {
    // Who waits for the GPU waits for no lock, even if nobody can see that work of its is under
    // way.
    if (task.slot->state.load(kRelaxed) == abi::TaskState::kIdle || task.waits.load(kRelaxed) ||
        task.is_unseen.load(kRelaxed))
        return false;
    const auto awaited =
        sched::stalled(*task.slot, governor_.tasks().look(task, now), task.cpu_jitter.seen());
    return awaited && sched::is_lent(*awaited, held_deadline, now - later);
}

nanoseconds Runtime::deadline_of_held(const TaskState& task, nanoseconds now) const {
    // Who is late, or given up, comes after all that can be met.
    const abi::TaskSlot& slot = *task.slot;
    const nanoseconds own(slot.deadline_ns.load(kRelaxed));
    const bool is_last =
        now + model::corrected(slot, nanoseconds(slot.head_remaining_ns.load(kRelaxed))) > own ||
        (plan_.given_up.contains(task.index));
    return is_last ? nanoseconds::max() : own;
}

bool Runtime::is_lent_urgency(const TaskState& task, nanoseconds deadline, nanoseconds now,
                              nanoseconds later) {
    for (const auto& chain : chains_) {
        if (chain.get() == task.chain || chain->config.mode != config::Mode::kEnforce) continue;
        if (is_absent(*chain, deadline, now, later)) {
            chain->expectation.lend(now);
            return true;
        }
        for (const int index : chain->tasks)
            if (has_stalled(*tasks_[static_cast<std::size_t>(index)], deadline, now, later))
                return true;
    }
    return false;
}

// Its work is on its way and cannot be given another priority: the others have to make room, and
// whose it is is believed to need the GPU for as long as what they have there lasts.
void Runtime::lend_along(TaskState& task, TaskState& waited_for, nanoseconds until) {
    if (!enforces(task) || !enforces(waited_for)) return;
    const nanoseconds now = clock_.now();
    const model::SlotView self = governor_.tasks().look(task, now),
                          other = governor_.tasks().look(waited_for, now);
    if (!self.active || !other.active || self.deadline >= other.deadline) return;
    abi::TaskSlot& slot = *waited_for.slot;
    const std::uint32_t done = slot.marks_done.load(kRelaxed);
    const nanoseconds executed(slot.launched_at_mark_ns[done % abi::kMarkRing].load(kRelaxed));
    if (!model::lend_deadline(slot, {self.deadline, until, self.criticality, self.static_rank},
                              executed))
        return;
    nanoseconds before{0};
    governor_.tasks().for_each_active([&](sched::GovernedTask& t) {
        if (&t != &waited_for) before += governor_.tasks().look(t, now).launched;
    });
    const nanoseconds patience = other.waited + other.patience;
    const std::int64_t clear_ns = (now + patience + 2 * before).count();
    std::int64_t last_ns = slot.cleared_until_ns.load(kRelaxed);
    while (last_ns < clear_ns &&
           !slot.cleared_until_ns.compare_exchange_weak(last_ns, clear_ns, kRelaxed)) {
    }
    plan_is_needed();
    governor_.tasks().changed();
}

// The launch that is held goes, behind all others.
void Runtime::lend_urgency(TaskState& task, const model::SlotView& self, Look& look,
                           nanoseconds now) {
    if (look.decision.admit && look.within_run_ahead) return;
    // Other ways to hold are as they were published.
    if (scheduler_.admission != config::Admission::kPacked) return;
    const nanoseconds later = look.decision.admit ? sched::kPacedLater : nanoseconds{0};
    if (look.decision.rank == 0 ||
        !is_lent_urgency(task, deadline_of_held(task, now), now, later)) {
        // Who waits for its own work alone takes from nobody what it launches now: so less urgent
        // ones are awaited, too.
        if (look.decision.admit && is_lent_urgency(task, nanoseconds::max(), now, later)) {
            look.within_run_ahead = true;
            task.decision.time = nanoseconds{-1'000'000'000};
            bump(task.counters.lent);
        }
        return;
    }
    sched::Snapshot snapshot{now, {&self, 1}};
    snapshot.lent = true;
    look.decision = sched::decide(scheduler_, snapshot);
    look.within_run_ahead = true;
    task.decision.time = nanoseconds{-1'000'000'000};  // of this launch alone
    bump(task.counters.lent);
}

}  // namespace urgengo::runtime
