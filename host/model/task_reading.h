// SPDX-License-Identifier: Apache-2.0
//
// What a look reads of a slot, as plain numbers, and what follows from them. Host and GPU share
// both, so that they see the same of a task, to the bit: whoever decides.
//
// @threads any; pure but for the loads
#pragma once

#include <algorithm>
#include <cstdint>

#include "host/base/host_device.h"
#include "host/model/slot_view.h"
#include "host/model/unmarked_work.h"
#include "host/model/urgency.h"
#include "urgengo/abi/shared_page.h"

namespace urgengo::model {

struct TaskReading {
    abi::TaskState state = abi::TaskState::kIdle;
    // As the slot has them:
    std::int64_t deadline_ns = 0, later_gpu_ns = 0, later_cpu_ns = 0, later_idle_ns = 0;
    std::int64_t cpu_until_ns = 0, period_ns = 0;
    std::int64_t head_remaining_ns = 0, head_idle_ns = 0;
    std::int64_t launched_ns = 0, launch_ns = 0, look_ns = 0;
    std::int64_t sync_until_ns = 0, unmarked_until_ns = 0, progress_ns = 0, cleared_until_ns = 0;
    std::int64_t relative_deadline_ns = 0, chain_gpu_ns = 0, chain_cpu_ns = 0;
    std::int64_t lent_until_ns = 0, lent_deadline_ns = 0;
    std::int64_t turn_until_ns = 0, gate_opened_ns = 0;
    std::uint32_t head_utilization_ppm = 0, mean_utilization_ppm = 0, factor_ppm = 0;
    std::uint32_t static_rank = 0, lent_static_rank = 0;
    std::uint32_t started = 0, is_supported = 0, waits = 0;
    std::uint16_t criticality = 0, demotes = 0, lent_criticality = 0;
    abi::Launching launching = abi::Launching::kUnknown;
    abi::Why queue_why = abi::Why::kNone;
    // Of its marks, once it is known which of them have executed:
    std::uint32_t issued = 0, done = 0;
    std::int64_t executed_ns = 0;  ///< launched_ns before mark `done`
    std::int64_t next_ns = 0;      ///< and before the one after it
    // Of its gates:
    std::uint32_t gates_closed = 0, gates_opened = 0;
    std::int64_t gate_begin_ns = 0;  ///< launched_ns before the first closed one

    constexpr bool is_gated() const { return gates_closed != gates_opened; }
};

constexpr bool is_later_mark(std::uint32_t a, std::uint32_t b) {
    return static_cast<std::int32_t>(a - b) > 0;
}

/// All but what is of marks.
URGENGO_HOST_DEVICE inline TaskReading load_slot(const abi::TaskSlot& slot) {
    TaskReading r;
    r.state = load_shared(slot.state);
    r.deadline_ns = load_shared(slot.deadline_ns);
    r.later_gpu_ns = load_shared(slot.later_gpu_ns);
    r.later_cpu_ns = load_shared(slot.later_cpu_ns);
    r.later_idle_ns = load_shared(slot.later_idle_ns);
    r.cpu_until_ns = load_shared(slot.cpu_until_ns);
    r.period_ns = load_shared(slot.period_ns);
    r.head_utilization_ppm = load_shared(slot.head_utilization_ppm);
    r.head_remaining_ns = load_shared(slot.head_remaining_ns);
    r.head_idle_ns = load_shared(slot.head_idle_ns);
    r.launched_ns = load_shared(slot.launched_ns);
    r.launch_ns = load_shared(slot.launch_ns);
    r.look_ns = load_shared(slot.look_ns);
    r.sync_until_ns = load_shared(slot.sync_until_ns);
    r.started = load_shared(slot.started);
    r.unmarked_until_ns = load_shared(slot.unmarked_until_ns);
    r.progress_ns = load_shared(slot.progress_ns);
    r.cleared_until_ns = load_shared(slot.cleared_until_ns);
    r.turn_until_ns = load_shared(slot.turn_until_ns);
    r.relative_deadline_ns = load_shared(slot.relative_deadline_ns);
    r.chain_gpu_ns = load_shared(slot.chain_gpu_ns);
    r.chain_cpu_ns = load_shared(slot.chain_cpu_ns);
    r.criticality = load_shared(slot.criticality);
    r.demotes = load_shared(slot.demotes);
    r.static_rank = load_shared(slot.static_rank);
    r.mean_utilization_ppm = load_shared(slot.mean_utilization_ppm);
    r.factor_ppm = load_shared(slot.factor_ppm);
    r.is_supported = load_shared(slot.is_supported);
    r.launching = load_shared(slot.launching);
    r.lent_until_ns = load_shared(slot.lent_until_ns);
    r.waits = load_shared(slot.waits);
    r.gates_closed = load_shared(slot.gates_closed);
    // Cache lines that most looks have no use for. The GPU asks for all at once.
    if (kOnGpu || r.lent_until_ns != 0) {
        r.lent_deadline_ns = load_shared(slot.lent_deadline_ns);
        r.lent_static_rank = load_shared(slot.lent_static_rank);
        r.lent_criticality = load_shared(slot.lent_criticality);
    }
    if (kOnGpu || r.state == abi::TaskState::kHeld) r.queue_why = load_shared(slot.queue_why);
    if (kOnGpu || r.gates_closed != 0) {
        r.gates_opened = load_shared(slot.gates_opened);
        r.gate_opened_ns = load_shared(slot.gate_opened_ns);
    }
    if (r.is_gated())
        r.gate_begin_ns = load_shared(slot.group_begin_ns[(r.gates_opened + 1) % abi::kGateRing]);
    return r;
}

/// @param issued, done  last marks issued and executed, read in any order
URGENGO_HOST_DEVICE inline void load_marks(TaskReading& r, const abi::TaskSlot& slot,
                                           std::uint32_t issued, std::uint32_t done) {
    if (is_later_mark(done, issued)) issued = done;
    // With more marks in flight than the ring holds, the oldest that it still has.
    if (issued - done >= abi::kMarkRing) done = issued - abi::kMarkRing + 1;
    r.issued = issued;
    r.done = done;
    r.executed_ns = load_shared(slot.launched_at_mark_ns[done % abi::kMarkRing]);
    r.next_ns = issued == done ? r.executed_ns
                               : load_shared(slot.launched_at_mark_ns[(done + 1) % abi::kMarkRing]);
}

/// @param ppm  of the slot
/// @returns GPU time of launches whose estimates by the plan add up to `estimated`
constexpr nanoseconds corrected_by(std::uint32_t ppm, nanoseconds estimated) {
    if (ppm == 0) return estimated;
    return nanoseconds(
        static_cast<std::int64_t>(static_cast<double>(estimated.count()) * (ppm * 1e-6)));
}

/// After which what should take so long is overdue.
constexpr nanoseconds patience_for(nanoseconds estimate) {
    return nanoseconds(2 * estimate.count() + kOverdue_ns);
}

/// Makes a view one of the work that is due by a lent deadline (lent_deadline.h), if that helps.
constexpr void apply_lent(SlotView& view, const TaskReading& r, nanoseconds now) {
    const nanoseconds lent(r.lent_deadline_ns);
    if (r.lent_until_ns <= r.executed_ns || lent >= view.deadline) return;
    const nanoseconds due = std::min(
        corrected_by(r.factor_ppm, nanoseconds(r.lent_until_ns - r.executed_ns)), view.launched);
    const nanoseconds due_laxity = laxity({lent, due, nanoseconds{0}}, now);
    if (due_laxity.count() < 0 && view.laxity.count() >= 0) return;
    view.deadline = lent;
    view.laxity = due_laxity;
    view.remaining_gpu = due;
    view.remaining_idle = view.later_idle = nanoseconds{0};
    view.remaining_cpu = view.later_cpu = view.later_gpu = nanoseconds{0};
    view.demoted = false;
    view.criticality = std::max(view.criticality, static_cast<int>(r.lent_criticality));
    view.static_rank = std::min(view.static_rank, static_cast<int>(r.lent_static_rank));
}

/// What its chain is.
constexpr void view_chain(SlotView& view, const TaskReading& r) {
    view.period = nanoseconds(r.period_ns);
    view.relative_deadline = nanoseconds(r.relative_deadline_ns);
    view.chain_gpu = nanoseconds(r.chain_gpu_ns);
    view.chain_cpu = nanoseconds(r.chain_cpu_ns);
    view.criticality = r.criticality;
    view.static_rank = static_cast<int>(r.static_rank);
    view.mean_utilization = r.mean_utilization_ppm * 1e-6;
    view.is_supported = r.is_supported != 0;
    view.launching = r.launching;
}

/// How long its first unexecuted work has waited, and whether that is too long. Right behind a
/// closed gate nothing is: what waits there waits for others.
constexpr void view_waiting(SlotView& view, const TaskReading& r, nanoseconds now) {
    view.pending = r.issued != r.done;
    const nanoseconds since(std::max(view.pending ? r.progress_ns : r.launch_ns, r.gate_opened_ns));
    if (view.pending || view.launched.count() > 0) {
        view.waited = now - since;
        view.patience = patience_for(
            view.pending ? corrected_by(r.factor_ppm, nanoseconds(r.next_ns - r.executed_ns))
                         : view.launched);
    }
    if (r.is_gated() && r.executed_ns >= r.gate_begin_ns) view.waited = nanoseconds{0};
    view.overdue = view.waited > view.patience;
}

/// @returns the view of an active task: all but `progressed` and `starved`
constexpr SlotView view_of(const TaskReading& r, int task, nanoseconds now) {
    using abi::TaskState;
    SlotView view;
    view.task = task;
    view.active = true;
    const bool on_cpu = r.state == TaskState::kCpu;
    view.deadline = nanoseconds(r.deadline_ns);
    view.later_gpu = nanoseconds(r.later_gpu_ns);
    view.later_cpu = nanoseconds(r.later_cpu_ns);
    view.utilization = r.head_utilization_ppm * 1e-6;
    view.launched = corrected_by(
        r.factor_ppm, std::max(nanoseconds(r.launched_ns - r.executed_ns), nanoseconds{0}));
    view.started = r.started != 0;
    view.release = on_cpu ? std::max(now, nanoseconds(r.cpu_until_ns)) : now;
    // What no mark can tell of goes by time, from the last one on.
    nanoseconds under_way = view.launched;
    if (r.unmarked_until_ns != 0 && r.issued == r.done)
        under_way = UnmarkedWork::left(view.launched, nanoseconds(r.unmarked_until_ns),
                                       nanoseconds(r.progress_ns), now);
    view.remaining_gpu =
        corrected_by(r.factor_ppm, nanoseconds(r.head_remaining_ns)) + under_way + view.later_gpu;
    // While it has work there, the GPU waits for no launch.
    view.later_idle = nanoseconds(r.later_idle_ns);
    view.remaining_idle =
        view.later_idle + std::max(nanoseconds(r.head_idle_ns) - under_way, nanoseconds{0});
    view.remaining_cpu = view.later_cpu + view.release - now;
    view_chain(view, r);
    view.laxity =
        laxity({view.deadline, view.remaining_gpu + view.remaining_idle, view.remaining_cpu}, now);
    view.demoted = r.demotes != 0 && view.laxity.count() < 0;
    // A frame that came too early (sched/bandwidth.h) is as little urgent as one that is late,
    // until it is due.
    if (view.relative_deadline.count() > 0 && view.arrival() > now)
        view.laxity = std::min(view.laxity, nanoseconds{-1});
    view_waiting(view, r, now);

    // It waits for the work of all tasks: no less urgent task may add to that. When that work
    // should be done and is not, the task counts for what it has on the GPU, as any other.
    view.needs_all = r.state == TaskState::kSync && now.count() <= r.sync_until_ns;
    if (view.needs_all) {
        view.utilization = 1;
        view.overdue = false;
    }
    const nanoseconds last_look(r.look_ns);
    const bool held = r.is_gated() || (r.state == TaskState::kHeld &&
                                       (now - last_look).count() < kHeldHeartbeat_ns);
    const nanoseconds last = std::max(nanoseconds(r.launch_ns), last_look);
    // A thread that waits for the GPU is about to launch nothing.
    const bool between_launches = r.waits == 0 && (now - last).count() < kLaunchGrace_ns;
    const bool has_more = r.head_remaining_ns > 0;
    const bool waits_to_launch = held && r.queue_why == abi::Why::kTurnToLaunch;
    // A task that waits for the GPU has launched for now, whatever is left of the instance.
    view.launches =
        r.waits == 0 && (is_launching(r.state, nanoseconds(r.head_remaining_ns), last, now) ||
                         (has_more && waits_to_launch));
    view.pauses = r.waits == 0 && has_more && r.state == TaskState::kGpu && !view.launches;
    view.ranked =
        !on_cpu && (view.needs_all || held || between_launches || view.launched.count() > 0);
    view.blocking = view.ranked && (!view.overdue || now.count() < r.cleared_until_ns);
    apply_lent(view, r, now);
    return view;
}

}  // namespace urgengo::model
