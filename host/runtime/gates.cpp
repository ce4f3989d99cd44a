// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/gates.h"

#include <algorithm>

#include "host/base/memory_orders.h"
#include "host/base/own_time.h"
#include "host/sched/gate_groups.h"
#include "host/sched/instance_slot.h"
#include "host/sched/mark_spacing.h"

namespace urgengo::runtime {
namespace {

using abi::TaskSlot;

}  // namespace

// An instance waits in one way: its threads' sleeps and its gates are not mixed.
bool Gates::are_wanted(TaskState& task) {
    GatedLaunches& gates = task.gates;
    const std::uint32_t instance = task.slot->instance.load(kRelaxed);
    if (gates.instance != instance) {
        gates.instance = instance;
        gates.are_wanted = common_.gate_keeper.are_wanted();
    }
    return gates.are_wanted;
}

bool Gates::may_close(TaskState& task, const sched::Wait& wait) {
    const TrackedRun& tracked = task.tracked;
    if (!sched::may_stand_behind_gate(task, wait, common_.governor.company().is_alone()))
        return false;
    if (!segments_.vouches(task) || exec::is_default_stream(tracked.stream)) return false;
    // What the legacy stream launches waits for all streams that are not of this kind.
    unsigned flags = 0;
    if (!common_.driver.cuStreamGetFlags ||
        common_.driver.cuStreamGetFlags(tracked.stream, &flags) != CUDA_SUCCESS ||
        (flags & CU_STREAM_NON_BLOCKING) == 0)
        return false;
    task.gates.dispatch = common_.gate_keeper.dispatcher().prepare(*tracked.marks);
    return task.gates.dispatch && common_.gate_keeper.begins();
}

bool Gates::close(TaskState& task, const sched::Answer& answer, nanoseconds now) {
    if (!are_on() || !are_wanted(task) || !may_close(task, *answer.wait)) return false;
    GateKeeper& keeper = common_.gate_keeper;
    keeper.publish_clock(now);
    if (keeper.are_opened_by_gpu())
        exec::ProgressMarks::dispatch_by(*task.tracked.marks, *task.gates.dispatch);
    GatedLaunches& gates = task.gates;
    gates.is_open = false;
    gates.is_hold = !answer.wait->is_paced;
    gates.decision = answer.decision;
    gates.stream = task.tracked.stream;
    gates.since = now;
    gates.behind = 1;
    const nanoseconds bound = common_.governor.hold_bound(task) - task.run.waited.held;
    task.slot->gate_by_ns.store((now + std::max(bound, nanoseconds{0})).count(), kRelaxed);
    if (!put(task, now)) {
        keeper.ends(task, now);
        return false;
    }
    if (gates.is_hold) bump(task.counters.holds);
    common_.observers.nvtx.gates(task, observe::nvtx::Word::kGateClosed);
    common_.governor.sleeps(task, *answer.wait);
    gates.piece.flags = abi::kRunGate;
    common_.observers.records.held(task, gates.piece, *answer.wait, now);
    return true;
}

// The group and the gate are in the slot before the mark tells of the gate. A mark is never left
// out: without one nothing would open the gate but time.
bool Gates::put(TaskState& task, nanoseconds now) {
    TaskSlot& slot = *task.slot;
    if (!task.run.on_gpu || sched::MarkSpacing::ring_is_full(slot)) return false;
    const std::uint32_t gate =
        sched::close_next_gate(task, common_.governor.ahead().run_ahead.bound(task, now));
    const std::uint32_t issued = slot.marks_issued.load(kRelaxed);
    segments_.emit_mark(task, now, GpuSegments::Place::kBeforeGate);
    const bool is_put = slot.marks_issued.load(kRelaxed) != issued &&
                        common_.gate_keeper.dispatcher().close(*task.gates.dispatch, task.index,
                                                               gate, task.tracked.stream,
                                                               task.tracked.flavor) == CUDA_SUCCESS;
    // Older ones are open before it is: the word counts.
    if (!is_put) wait_until_open(task, gate - 1);
    // A thread that has parked meanwhile has not seen this gate.
    if (!is_put || common_.gate_keeper.is_parked()) sched::open_gate(slot, gate, now);
    if (is_put) common_.gate_keeper.closed();
    return is_put;
}

bool Gates::takes(TaskState& task, nanoseconds now) {
    GatedLaunches& gates = task.gates;
    if (gates.is_open) return false;
    TaskSlot& slot = *task.slot;
    slot.look_ns.store(now.count(), kRelaxed);
    const std::uint32_t last = slot.gates_closed.load(kRelaxed);
    const std::uint32_t closed = sched::closed_gates(slot);
    const auto most = static_cast<std::uint32_t>(common_.scheduler.dispatch.most_gates);
    const bool has_room = gates.behind < sched::kMostBehindGates;
    if (closed != 0 && !is_beside(task) && has_room) {
        if (sched::joins_group(slot, task.run.next, common_.scheduler.dispatch.gate_group))
            return ++gates.behind, true;
        if (closed < most && put(task, now)) {
            ++gates.behind;
            rank_anew(task, now);
            return true;
        }
    }
    if (closed != 0) {
        // Elsewhere it would overtake what stands behind the gates.
        const bool is_half_enough = has_room && closed >= most && !is_beside(task);
        wait_until_open(task, is_half_enough ? last - most / 2 : last);
        now = common_.clock.now();
        gates.behind = 0;
        if (are_closed(task) && !is_beside(task) && put(task, now)) {
            gates.behind = 1;
            rank_anew(task, now);
            return true;
        }
        wait_until_open(task, slot.gates_closed.load(kRelaxed));
    }
    common_.gate_keeper.ends(task, common_.clock.now());
    return false;
}

void Gates::rank_anew(TaskState& task, nanoseconds now) {
    const sched::Request request{.enforces = common_.enforces(task)};
    const sched::Answer answer = common_.governor.ask(task, request, now);
    task.gates.decision = answer.decision;
    if (!answer.wait) common_.gate_keeper.changed();
}

void Gates::wait_until_open(TaskState& task, std::uint32_t gate) {
    TaskSlot& slot = *task.slot;
    const auto is_closed = [&] { return sched::is_gate_closed(slot, gate); };
    if (!is_closed()) return;
    const own_time::Held held;
    const FineTimerSlack slack;
    const nanoseconds begin = common_.clock.now();
    nanoseconds now = begin;
    HoldPiece piece;
    common_.observers.records.held(task, piece, {.why = abi::Why::kRunAhead, .is_paced = true},
                                   begin);
    set_state(task, abi::TaskState::kHeld);
    task.taking.held_frame = __builtin_frame_address(0);
    while (is_closed() && common_.may_hold(task)) {
        common_.clock.sleep_for(common_.scheduler.hold.poll);
        now = common_.clock.now();
        slot.look_ns.store(now.count(), kRelaxed);
        common_.gate_keeper.changed();
    }
    common_.observers.records.hold_ended(task, piece, now);
    task.taking.held_frame = nullptr;
    if (task.run.on_gpu) set_state(task, abi::TaskState::kGpu);
    task.run.waited.paced += now - begin;
    bump(task.counters.paced_ns, std::int64_t{(now - begin).count()});
}

}  // namespace urgengo::runtime
