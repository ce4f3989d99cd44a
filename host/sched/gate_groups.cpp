// SPDX-License-Identifier: Apache-2.0
#include "host/sched/gate_groups.h"

#include <algorithm>

#include "host/base/memory_orders.h"

namespace urgengo::sched {
namespace {

/// Utilisations of a group's launches differ by so much at most.
constexpr std::uint32_t kAlike_ppm = 200'000;

}  // namespace

bool may_stand_behind_gate(const GovernedTask& task, const Wait& wait, bool is_alone) {
    if (wait.why != Why::kRank && wait.why != Why::kRunAhead && wait.why != Why::kDrain)
        return false;
    // Alone it has more ahead of it than a thread's sleep, and gates cost the GPU's time.
    if (wait.why == Why::kRunAhead && is_alone) return false;
    return !task.record.overlaps && task.slot->launching.load(kRelaxed) != abi::Launching::kSlowed;
}

// The group is in the slot before a round can know of its gate.
std::uint32_t close_next_gate(GovernedTask& task, nanoseconds run_ahead) {
    abi::TaskSlot& slot = *task.slot;
    const std::uint32_t gate = slot.gates_closed.load(kRelaxed) + 1;
    const std::uint32_t at = gate % abi::kGateRing;
    slot.group_begin_ns[at].store(task.work.launched.count(), kRelaxed);
    slot.group_time_ns[at].store(task.run.next.count(), kRelaxed);
    slot.group_utilization_ppm[at].store(slot.head_utilization_ppm.load(kRelaxed), kRelaxed);
    slot.run_ahead_ns.store(run_ahead.count(), kRelaxed);
    slot.gates_closed.store(gate, std::memory_order_release);
    return gate;
}

bool joins_group(abi::TaskSlot& slot, nanoseconds next, nanoseconds most) {
    const std::uint32_t at = slot.gates_closed.load(kRelaxed) % abi::kGateRing;
    const nanoseconds time = nanoseconds(slot.group_time_ns[at].load(kRelaxed)) + next;
    const std::uint32_t of_group = slot.group_utilization_ppm[at].load(kRelaxed);
    const std::uint32_t own = slot.head_utilization_ppm.load(kRelaxed);
    if (time > most || std::max(own, of_group) - std::min(own, of_group) > kAlike_ppm) return false;
    slot.group_time_ns[at].store(time.count(), kRelaxed);
    slot.group_utilization_ppm[at].store(std::max(own, of_group), kRelaxed);
    return true;
}

std::uint32_t closed_gates(const abi::TaskSlot& slot) {
    return slot.gates_closed.load(kRelaxed) - slot.gates_opened.load(kAcquire);
}

bool is_gate_closed(const abi::TaskSlot& slot, std::uint32_t gate) {
    return static_cast<std::int32_t>(gate - slot.gates_opened.load(kAcquire)) > 0;
}

nanoseconds waited_behind_gates(const abi::TaskSlot& slot, nanoseconds since, nanoseconds now) {
    const nanoseconds opened(slot.gate_opened_ns.load(kRelaxed));
    return std::clamp(opened - since, nanoseconds{1}, now - since + nanoseconds{1});
}

}  // namespace urgengo::sched
