// SPDX-License-Identifier: Apache-2.0
//
// Copies wait for those of more urgent tasks: see runtime/copies.cpp, 3.
#include <algorithm>
#include <array>

#include "host/exec/relaxed_capture_mode.h"
#include "host/runtime/copies.h"
#include "host/runtime/thread_state.h"

namespace urgengo::runtime {

bool Copies::any_copies_but(const TaskState& task, nanoseconds now) const {
    return std::any_of(around_.tasks.begin(), around_.tasks.end(), [&](const auto& other) {
        return other.get() != &task && other->copies.published.may_be_any(now);
    });
}

bool Copies::urgent_copies(const CopyTurn& turn, nanoseconds now) {
    if (!around_.guard.enforces(turn.task->chain->index)) return false;
    std::array<bool, abi::kMaxTasks> copies{};
    bool any = false;
    {
        const exec::RelaxedCaptureMode relaxed(around_.driver);
        const auto ask = [this](CUevent event) { return around_.driver.cuEventQuery(event); };
        for (const auto& other : around_.tasks) {
            if (other.get() == turn.task || !other->copies.published.may_be_any(now)) continue;
            bool& its = copies[static_cast<std::size_t>(other->index)];
            its = other->copies.published.are_at_engine(now, turn.context, ask);
            any = any || its;
        }
    }
    if (!any) return false;
    sched::Answer answer;  // its thread has the task
    const bool waits = around_.governor.copy_waits(*turn.task, copies, answer, now);
    if (answer.has_made_plan) around_.governor.plan().took(around_.clock.now() - now);
    return waits;
}

// Its thread alone waits, at its task: as with a launch, helpers go unscheduled meanwhile. Not
// between two events that take the time.
/// @returns whether it has waited
bool Copies::hold(ThreadState& thread, const CopyTurn& turn) {
    TaskState& task = *turn.task;
    nanoseconds last = around_.clock.now();
    if (!any_copies_but(task, last)) return false;
    if (thread.measuring || !threads_.take_own(thread, task)) return false;
    sched::GovernedRun& run = task.run;
    run.pace.no_gap();
    const nanoseconds bound = around_.governor.hold_bound(task);
    // By the rules of launches (host/README.md, rules of holding), but that nothing is lent: whose
    // copies are under way looks as if its thread had stalled.
    const auto must_wait = [&](nanoseconds now) {
        around_.governor.look_for_bystanders(now);
        return run.waited.held < bound && !around_.governor.bystanders().are_busy() &&
               !around_.governor.polls().is_over(now) && urgent_copies(turn, now);
    };
    const auto may_hold = [&] {
        return around_.governor.steered().enforces() && task.chain->may_act();
    };
    const bool waits = !run.observed && may_hold() && must_wait(last);
    if (waits) {
        bump(task.counters.holds);
        const FineTimerSlack slack;
        const nanoseconds begin = last;
        HoldPiece piece{.flags = abi::kRunCopy};
        around_.records.held(task, piece, {.why = abi::Why::kRank}, last);
        task.taking.held_frame = __builtin_frame_address(0);
        bool goes_on = false;
        do {
            around_.clock.sleep_for(around_.governor.polls().rest(0, bound - run.waited.held));
            const nanoseconds now = around_.clock.now();
            run.waited.held += now - last;
            bump(task.counters.held_ns, std::int64_t{(now - last).count()});
            last = now;
            around_.governor.queue().waited(now);
            if (run.waited.held >= bound) bump(task.counters.holds_opened);
            goes_on = may_hold() && must_wait(last);
            around_.governor.polls().looked(last, around_.clock.now());
        } while (goes_on);
        // Its thread does not learn whose copies it waited for.
        task.facts.holds.add({.arrival = task.tracked.arrival,
                              .begin = begin,
                              .end = last,
                              .behind = observe::kUnknownChain});
        around_.records.hold_ended(task, piece, last);
        task.taking.held_frame = nullptr;
    }
    threads_.release(thread);
    return waits;
}

// The thread has waited for its copies: others may go on.
void Copies::waited_for(ThreadState& thread, const Wait& wait) {
    const bool names_stream = wait.function == abi::TraceWait::kStream ||
                              wait.function == abi::TraceWait::kStreamQuery ||
                              wait.function == abi::TraceWait::kCopy;
    const bool its_stream = names_stream && wait.stream == thread.copied.stream &&
                            (wait.stream || wait.flavor == thread.copied.flavor);
    const bool for_all = wait.function == abi::TraceWait::kContext;
    if (!for_all && !its_stream) return;
    thread.copied.task->copies.published.over(thread.copied.ticket, for_all);
    thread.copied.task = nullptr;
}

}  // namespace urgengo::runtime
