// SPDX-License-Identifier: Apache-2.0
//
// Urgency is lent: a task that is held goes while a more urgent one does not come, which may be
// waiting for a lock that the held thread has (sched/absence.h). Asked when a launch would
// have to wait, and at each poll then.
#include "host/runtime/runtime.h"
#include "host/sched/admission.h"

namespace urgengo::runtime {
namespace {

constexpr auto kRelaxed = std::memory_order_relaxed;

}  // namespace

bool Runtime::is_absent(const ChainState& chain, nanoseconds held_deadline, nanoseconds now) const {
    const TaskState& first = *tasks_[static_cast<std::size_t>(chain.tasks.front())];
    const bool is_at_work = first.slot->state.load(kRelaxed) != abi::TaskState::kIdle;
    if (is_at_work) return false;
    const nanoseconds cpu(first.cpu_time_ns.load(kRelaxed));
    const auto awaited = chain.expectation.awaited(chain.config.period, chain.config.deadline, cpu);
    return awaited && sched::is_lent(*awaited, held_deadline, now);
}

bool Runtime::has_stalled(TaskState& task, nanoseconds held_deadline, nanoseconds now) {
    // Who waits for the GPU waits for no lock, even if nobody can see that work of its is under
    // way.
    if (task.slot->state.load(kRelaxed) == abi::TaskState::kIdle || task.waits.load(kRelaxed) ||
        task.is_unseen.load(kRelaxed))
        return false;
    const auto awaited = sched::stalled(*task.slot, look_at(task, now), task.cpu_jitter.seen());
    return awaited && sched::is_lent(*awaited, held_deadline, now);
}

bool Runtime::is_lent_urgency(const TaskState& task, nanoseconds now) {
    // Who is late, or given up, comes after all that can be met.
    const abi::TaskSlot& slot = *task.slot;
    const nanoseconds own(slot.deadline_ns.load(kRelaxed));
    const bool is_last =
        now + model::corrected(slot, nanoseconds(slot.head_remaining_ns.load(kRelaxed))) > own ||
        (plan_.given_up.contains(task.index));
    const nanoseconds deadline = is_last ? nanoseconds::max() : own;
    for (const auto& chain : chains_) {
        if (chain.get() == task.chain || chain->config.mode != config::Mode::kEnforce) continue;
        if (is_absent(*chain, deadline, now)) {
            chain->expectation.lend(now);
            return true;
        }
        for (const int index : chain->tasks)
            if (has_stalled(*tasks_[static_cast<std::size_t>(index)], deadline, now)) return true;
    }
    return false;
}

// The launch that is held goes, behind all others.
void Runtime::lend_urgency(TaskState& task, const model::SlotView& self, Look& look,
                           nanoseconds now) {
    // The first in rank waits for its own work alone.
    if (look.decision.admit && (look.within_run_ahead || look.decision.rank == 0)) return;
    // Other ways to hold are as they were published.
    if (scheduler_.admission != config::Admission::kPacked) return;
    if (!is_lent_urgency(task, now)) return;
    sched::Snapshot snapshot{now, {&self, 1}};
    snapshot.lent = true;
    look.decision = sched::decide(scheduler_, snapshot);
    look.within_run_ahead = true;
    task.decision.time = nanoseconds{-1'000'000'000};  // of this launch alone
    bump(task.counters.lent);
}

}  // namespace urgengo::runtime
