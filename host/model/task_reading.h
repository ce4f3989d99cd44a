// SPDX-License-Identifier: Apache-2.0
//
// What a look reads of a slot, as plain numbers, and what follows from them. Host and GPU share
// both, so that a task looks the same to both, to the bit.
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
    std::int64_t deadline_ns = 0, period_ns = 0;
    std::int64_t launched_ns = 0;
    struct Head {  // the launch at hand
        std::int64_t remaining_ns = 0, idle_ns = 0;
        std::uint32_t utilization_ppm = 0;
    } head;
    struct Later {
        std::int64_t gpu_ns = 0, cpu_ns = 0, idle_ns = 0;
    } later;
    struct Until {
        std::int64_t cpu_ns = 0, sync_ns = 0, cleared_ns = 0, turn_ns = 0;
        std::int64_t unmarked = 0;  ///< UnmarkedWork::word()
    } until;
    struct Last {
        std::int64_t launch_ns = 0, look_ns = 0, progress_ns = 0;
    } last;
    struct OfChain {
        std::int64_t relative_deadline_ns = 0, gpu_ns = 0, cpu_ns = 0;
        std::uint32_t static_rank = 0;
        std::uint16_t criticality = 0, demotes = 0;
    } chain;
    struct Lent {
        std::int64_t until_ns = 0, deadline_ns = 0;
        std::uint32_t static_rank = 0;
        std::uint16_t criticality = 0;
    } lent;
    struct Estimate {
        std::uint32_t mean_utilization_ppm = 0, factor_ppm = 0, is_supported = 0;
    } estimate;
    struct OfThread {
        std::uint32_t started = 0, waits = 0, launch_speed_pm = 0;
        abi::Launching launching = abi::Launching::kUnknown;
        abi::Why queue_why = abi::Why::kNone;
    } thread;
    struct Marks {  // once it is known which of them have executed
        std::uint32_t issued = 0, done = 0;
        std::int64_t executed_ns = 0;  ///< launched_ns before mark `done`
        std::int64_t next_ns = 0;      ///< and before the one after it
    } marks;
    struct Gates {
        std::uint32_t closed = 0, opened = 0;
        std::int64_t opened_ns = 0;
        std::int64_t begin_ns = 0;  ///< launched_ns before the first closed one
    } gates;

    constexpr bool is_gated() const { return gates.closed != gates.opened; }
};

constexpr bool is_later_mark(std::uint32_t a, std::uint32_t b) {
    return static_cast<std::int32_t>(a - b) > 0;
}

/// All but what is of marks.
/// @param at_once  cache lines that most looks have no use for are asked for, too, as a trip over
///                 the bus takes the GPU longer than them; the reading is the same
URGENGO_HOST_DEVICE inline TaskReading load_slot(const abi::TaskSlot& slot, bool at_once = kOnGpu) {
    TaskReading r;
    r.state = load_shared(slot.state);
    r.deadline_ns = load_shared(slot.deadline_ns);
    r.later.gpu_ns = load_shared(slot.later_gpu_ns);
    r.later.cpu_ns = load_shared(slot.later_cpu_ns);
    r.later.idle_ns = load_shared(slot.later_idle_ns);
    r.until.cpu_ns = load_shared(slot.cpu_until_ns);
    r.period_ns = load_shared(slot.period_ns);
    r.head.utilization_ppm = load_shared(slot.head_utilization_ppm);
    r.head.remaining_ns = load_shared(slot.head_remaining_ns);
    r.head.idle_ns = load_shared(slot.head_idle_ns);
    r.launched_ns = load_shared(slot.launched_ns);
    r.last.launch_ns = load_shared(slot.launch_ns);
    r.last.look_ns = load_shared(slot.look_ns);
    r.until.sync_ns = load_shared(slot.sync_until_ns);
    r.thread.started = load_shared(slot.started);
    r.thread.launch_speed_pm = load_shared(slot.launch_speed_pm);
    r.until.unmarked = load_shared(slot.unmarked_until);
    r.last.progress_ns = load_shared(slot.progress_ns);
    r.until.cleared_ns = load_shared(slot.cleared_until_ns);
    r.until.turn_ns = load_shared(slot.turn_until_ns);
    r.chain.relative_deadline_ns = load_shared(slot.relative_deadline_ns);
    r.chain.gpu_ns = load_shared(slot.chain_gpu_ns);
    r.chain.cpu_ns = load_shared(slot.chain_cpu_ns);
    r.chain.criticality = load_shared(slot.criticality);
    r.chain.demotes = load_shared(slot.demotes);
    r.chain.static_rank = load_shared(slot.static_rank);
    r.estimate.mean_utilization_ppm = load_shared(slot.mean_utilization_ppm);
    r.estimate.factor_ppm = load_shared(slot.factor_ppm);
    r.estimate.is_supported = load_shared(slot.is_supported);
    r.thread.launching = load_shared(slot.launching);
    r.lent.until_ns = load_shared(slot.lent_until_ns);
    r.thread.waits = load_shared(slot.waits);
    r.gates.closed = load_shared(slot.gates_closed);
    if (at_once || r.lent.until_ns != 0) {
        r.lent.deadline_ns = load_shared(slot.lent_deadline_ns);
        r.lent.static_rank = load_shared(slot.lent_static_rank);
        r.lent.criticality = load_shared(slot.lent_criticality);
    }
    if (at_once || r.state == abi::TaskState::kHeld)
        r.thread.queue_why = load_shared(slot.queue_why);
    if (at_once || r.gates.closed != 0) {
        r.gates.opened = load_shared(slot.gates_opened);
        r.gates.opened_ns = load_shared(slot.gate_opened_ns);
    }
    // What was asked for in vain does not count: the reading is the same.
    if (r.state != abi::TaskState::kHeld) r.thread.queue_why = abi::Why::kNone;
    if (r.gates.closed == 0) {
        r.gates.opened = 0;
        r.gates.opened_ns = 0;
    }
    if (r.is_gated())
        r.gates.begin_ns = load_shared(slot.group_begin_ns[(r.gates.opened + 1) % abi::kGateRing]);
    return r;
}

/// @param issued, done  last marks issued and executed, read in any order
URGENGO_HOST_DEVICE inline void load_marks(TaskReading& r, const abi::TaskSlot& slot,
                                           std::uint32_t issued, std::uint32_t done) {
    if (is_later_mark(done, issued)) issued = done;
    // With more marks in flight than the ring holds, the oldest that it still has.
    if (issued - done >= abi::kMarkRing) done = issued - abi::kMarkRing + 1;
    r.marks.issued = issued;
    r.marks.done = done;
    r.marks.executed_ns = load_shared(slot.launched_at_mark_ns[done % abi::kMarkRing]);
    r.marks.next_ns = issued == done
                          ? r.marks.executed_ns
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
    const nanoseconds lent(r.lent.deadline_ns);
    if (r.lent.until_ns <= r.marks.executed_ns || lent >= view.deadline) return;
    const nanoseconds due = std::min(
        corrected_by(r.estimate.factor_ppm, nanoseconds(r.lent.until_ns - r.marks.executed_ns)),
        view.ahead.launched);
    const nanoseconds due_laxity = laxity({lent, due, nanoseconds{0}}, now);
    if (due_laxity.count() < 0 && view.laxity.count() >= 0) return;
    view.deadline = lent;
    view.state.is_lent = true;
    view.laxity = due_laxity;
    view.remaining.gpu = due;
    view.remaining.idle = view.later.idle = nanoseconds{0};
    view.launching.speed_pm = 0;  // all of that is launched
    view.remaining.cpu = view.later.cpu = view.later.gpu = nanoseconds{0};
    view.state.demoted = false;
    view.chain.criticality = std::max(view.chain.criticality, static_cast<int>(r.lent.criticality));
    view.chain.static_rank = std::min(view.chain.static_rank, static_cast<int>(r.lent.static_rank));
}

/// What its chain is.
constexpr void view_chain(SlotView& view, const TaskReading& r) {
    view.period = nanoseconds(r.period_ns);
    view.chain.relative_deadline = nanoseconds(r.chain.relative_deadline_ns);
    view.chain.gpu = nanoseconds(r.chain.gpu_ns);
    view.chain.cpu = nanoseconds(r.chain.cpu_ns);
    view.chain.criticality = r.chain.criticality;
    view.chain.static_rank = static_cast<int>(r.chain.static_rank);
    view.mean_utilization = r.estimate.mean_utilization_ppm * 1e-6;
    view.is_supported = r.estimate.is_supported != 0;
    view.launching.slowed = r.thread.launching;
    view.launching.speed_pm = static_cast<int>(r.thread.launch_speed_pm);
}

/// How long its first unexecuted work has waited, and whether that is too long. Right behind a
/// closed gate nothing is: what waits there waits for others.
constexpr void view_waiting(SlotView& view, const TaskReading& r, nanoseconds now) {
    view.ahead.pending = r.marks.issued != r.marks.done;
    const nanoseconds since(
        std::max(view.ahead.pending ? r.last.progress_ns : r.last.launch_ns, r.gates.opened_ns));
    if (view.ahead.pending || view.ahead.launched.count() > 0) {
        view.ahead.waited = now - since;
        view.ahead.patience = patience_for(
            view.ahead.pending ? corrected_by(r.estimate.factor_ppm,
                                              nanoseconds(r.marks.next_ns - r.marks.executed_ns))
                               : view.ahead.launched);
    }
    if (r.is_gated() && r.marks.executed_ns >= r.gates.begin_ns) view.ahead.waited = nanoseconds{0};
    view.state.overdue = view.ahead.waited > view.ahead.patience;
}

/// @returns how much of what is launched has executed unseen: what no mark can tell of, up to the
///          next mark, goes by time from the last one on
constexpr nanoseconds executed_by_time(const SlotView& view, const TaskReading& r,
                                       nanoseconds now) {
    if (!UnmarkedWork::may_be_under_way(r.until.unmarked, r.marks.done)) return nanoseconds{0};
    nanoseconds open = view.ahead.launched;
    if (r.marks.issued != r.marks.done)
        open = std::clamp(
            corrected_by(r.estimate.factor_ppm, nanoseconds(r.marks.next_ns - r.marks.executed_ns)),
            nanoseconds{0}, open);
    return open - UnmarkedWork::left(open, UnmarkedWork::until(r.until.unmarked),
                                     nanoseconds(r.last.progress_ns), now);
}

/// @returns the view of an active task: all but `progressed` and `starved`
constexpr SlotView view_of(const TaskReading& r, int task, nanoseconds now) {
    using abi::TaskState;
    SlotView view;
    view.task = task;
    view.state.active = true;
    const bool on_cpu = r.state == TaskState::kCpu;
    view.deadline = nanoseconds(r.deadline_ns);
    view.later.gpu = nanoseconds(r.later.gpu_ns);
    view.later.cpu = nanoseconds(r.later.cpu_ns);
    view.utilization = r.head.utilization_ppm * 1e-6;
    view.ahead.launched =
        corrected_by(r.estimate.factor_ppm,
                     std::max(nanoseconds(r.launched_ns - r.marks.executed_ns), nanoseconds{0}));
    view.state.started = r.thread.started != 0;
    view.release = on_cpu ? std::max(now, nanoseconds(r.until.cpu_ns)) : now;
    const nanoseconds under_way = view.ahead.launched - executed_by_time(view, r, now);
    view.remaining.gpu = corrected_by(r.estimate.factor_ppm, nanoseconds(r.head.remaining_ns)) +
                         under_way + view.later.gpu;
    // While it has work there, the GPU waits for no launch.
    view.later.idle = nanoseconds(r.later.idle_ns);
    view.remaining.idle =
        view.later.idle + std::max(nanoseconds(r.head.idle_ns) - under_way, nanoseconds{0});
    view.remaining.cpu = view.later.cpu + view.release - now;
    view_chain(view, r);
    view.laxity =
        laxity({view.deadline, view.remaining.gpu + view.remaining.idle, view.remaining.cpu}, now);
    view.state.demoted = r.chain.demotes != 0 && view.laxity.count() < 0;
    // A frame that came too early (sched/bandwidth.h) is as little urgent as one that is late,
    // until it is due.
    if (view.chain.relative_deadline.count() > 0 && view.arrival() > now)
        view.laxity = std::min(view.laxity, nanoseconds{-1});
    view_waiting(view, r, now);

    // It waits for the work of all tasks: no less urgent task may add to that. When that work
    // should be done and is not, the task counts for what it has on the GPU, as any other.
    view.state.needs_all = r.state == TaskState::kSync && now.count() <= r.until.sync_ns;
    if (view.state.needs_all) {
        view.utilization = 1;
        view.state.overdue = false;
    }
    const nanoseconds last_look(r.last.look_ns);
    const bool held = r.is_gated() || (r.state == TaskState::kHeld &&
                                       (now - last_look).count() < kHeldHeartbeat_ns);
    const nanoseconds last = std::max(nanoseconds(r.last.launch_ns), last_look);
    // A thread that waits for the GPU is about to launch nothing.
    const bool between_launches = r.thread.waits == 0 && (now - last).count() < kLaunchGrace_ns;
    const bool has_more = r.head.remaining_ns > 0;
    const bool waits_to_launch = held && r.thread.queue_why == abi::Why::kTurnToLaunch;
    // A task that waits for the GPU has launched for now, whatever is left of the instance.
    view.launching.is_next = r.thread.waits == 0 &&
                             (is_launching(r.state, nanoseconds(r.head.remaining_ns), last, now) ||
                              (has_more && waits_to_launch));
    view.launching.pauses =
        r.thread.waits == 0 && has_more && r.state == TaskState::kGpu && !view.launching.is_next;
    view.state.ranked = !on_cpu && (view.state.needs_all || held || between_launches ||
                                    view.ahead.launched.count() > 0);
    view.state.blocking =
        view.state.ranked && (!view.state.overdue || now.count() < r.until.cleared_ns);
    apply_lent(view, r, now);
    return view;
}

}  // namespace urgengo::model
