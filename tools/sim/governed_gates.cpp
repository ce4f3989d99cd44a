// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/governed_gates.h"

#include <algorithm>

#include "host/base/memory_orders.h"
#include "host/sched/gate_groups.h"
#include "host/sched/mark_spacing.h"
#include "tools/sim/governed_streams.h"

namespace urgengo::sim {
namespace {

/// What a gate takes of the thread. @source measured: cuStreamWaitValue32, 0.6 to 1.0 us
constexpr nanoseconds kGateCpu{800};

}  // namespace

nanoseconds GovernedGates::mark(SimTask& task, nanoseconds now, abi::MarkRanks ranks) {
    const std::uint32_t issued = task.slot->marks_issued.load(kRelaxed);
    const nanoseconds cpu = marks_.emit(task, now);
    if (task.slot->marks_issued.load(kRelaxed) != issued) opener_.mark_issued(task, ranks);
    return cpu;
}

bool GovernedGates::is_beside(const SimTask& task) const {
    return task.branch != task.gates.branch || !streams::vouches(task, program_.follows_marks());
}

bool GovernedGates::close(SimTask& task, const sched::Answer& answer, nanoseconds now,
                          nanoseconds& owed) {
    sched::Governor& governor = program_.governor;
    const bool is_alone = governor.company().is_alone();
    if (!opener_.are_on() || !sched::may_stand_behind_gate(task, *answer.wait, is_alone) ||
        !streams::vouches(task, program_.follows_marks()) || !opener_.begins())
        return false;
    task.gates = {.is_open = false,
                  .is_hold = !answer.wait->is_paced,
                  .branch = task.branch,
                  .since = now,
                  .behind = 1,
                  .decision = answer.decision};
    const nanoseconds bound = governor.hold_bound(task) - task.run.waited.held;
    task.slot->gate_by_ns.store((now + std::max(bound, nanoseconds{0})).count(), kRelaxed);
    if (!put(task, now, owed)) {
        opener_.ends(task, now);
        return false;
    }
    governor.sleeps(task, *answer.wait);
    return true;
}

// The mark before it tells that its stream stands there.
bool GovernedGates::put(SimTask& task, nanoseconds now, nanoseconds& owed) {
    if (!task.run.on_gpu || sched::MarkSpacing::ring_is_full(*task.slot)) return false;
    const std::uint32_t gate =
        sched::close_next_gate(task, program_.governor.ahead().run_ahead.bound(task, now));
    owed += mark(task, now, abi::MarkRanks::kForItself) + kGateCpu;
    opener_.put(task, gate, now);
    return true;
}

void GovernedGates::rank_anew(SimTask& task, nanoseconds now) {
    const sched::Answer answer = program_.governor.ask(task, program_.request_for(task), now);
    task.gates.decision = answer.decision;
    if (!answer.wait) opener_.changed(now);
}

GovernedGates::Taken GovernedGates::takes(SimTask& task, nanoseconds now, nanoseconds& owed) {
    SimTask::Gates& gates = task.gates;
    if (gates.is_open) return Taken::kNot;
    abi::TaskSlot& slot = *task.slot;
    const config::DispatchSettings& dispatch = program_.scheduler().dispatch;
    const auto most = static_cast<std::uint32_t>(dispatch.most_gates);
    slot.look_ns.store(now.count(), kRelaxed);
    const std::uint32_t closed = sched::closed_gates(slot);
    const bool has_room = gates.behind < sched::kMostBehindGates;
    if (closed != 0 && !is_beside(task) && has_room) {
        if (sched::joins_group(slot, task.run.next, dispatch.gate_group))
            return ++gates.behind, Taken::kGoes;
        if (closed < most && put(task, now, owed)) {
            ++gates.behind;
            rank_anew(task, now);
            return Taken::kGoes;
        }
    }
    if (closed == 0) return opener_.ends(task, now), Taken::kNot;
    // Elsewhere it would overtake what stands behind the gates.
    const bool is_half_enough = has_room && closed >= most && !is_beside(task);
    const std::uint32_t last = slot.gates_closed.load(kRelaxed);
    return wait_until_open(task, is_half_enough ? last - most / 2 : last, now, owed);
}

GovernedGates::Taken GovernedGates::wait_until_open(SimTask& task, std::uint32_t gate,
                                                    nanoseconds now, nanoseconds& owed) {
    if (!sched::is_gate_closed(*task.slot, gate)) return waited(task, now, owed);
    task.gates.awaited = gate;
    task.gates.asleep_since = now;
    task.slot->state.store(abi::TaskState::kHeld, kRelaxed);
    return Taken::kSleeps;
}

GovernedGates::Taken GovernedGates::look_again(SimTask& task, nanoseconds now, nanoseconds& owed) {
    SimTask::Gates& gates = task.gates;
    task.run.waited.paced += now - gates.asleep_since;
    gates.asleep_since = now;
    task.slot->look_ns.store(now.count(), kRelaxed);
    opener_.changed(now);
    if (sched::is_gate_closed(*task.slot, *gates.awaited)) return Taken::kSleeps;
    gates.awaited.reset();
    task.slot->state.store(abi::TaskState::kGpu, kRelaxed);
    return waited(task, now, owed);
}

// As many are open as it has waited for: it closes a further one, or waits for all.
GovernedGates::Taken GovernedGates::waited(SimTask& task, nanoseconds now, nanoseconds& owed) {
    SimTask::Gates& gates = task.gates;
    abi::TaskSlot& slot = *task.slot;
    if (!gates.awaits_all) {
        gates.behind = 0;
        if (sched::closed_gates(slot) != 0 && !is_beside(task) && put(task, now, owed)) {
            gates.behind = 1;
            rank_anew(task, now);
            return Taken::kGoes;
        }
        gates.awaits_all = true;
        return wait_until_open(task, slot.gates_closed.load(kRelaxed), now, owed);
    }
    opener_.ends(task, now);
    return Taken::kNot;
}

}  // namespace urgengo::sim
