// SPDX-License-Identifier: Apache-2.0
//
// Urgency is lent (sched/lending.h): to whoever a program's stream waits for, and to whoever does
// not come while others are held.
#include "host/sched/lending.h"

#include "host/runtime/runtime.h"
#include "host/sched/admission.h"

namespace urgengo::runtime {

void Runtime::lend_along(TaskState& task, TaskState& waited_for, nanoseconds until) {
    if (!enforces(task) || !enforces(waited_for)) return;
    if (!sched::lend_along(governor_.tasks(), task, waited_for, until, clock_.now())) return;
    governor_.plan().is_needed();
    governor_.tasks().changed();
}

// The launch that is held goes, behind all others.
void Runtime::lend_urgency(TaskState& task, const model::SlotView& self, Look& look,
                           nanoseconds now) {
    if (look.decision.admit && look.within_run_ahead) return;
    const sched::Loan loan =
        sched::lend_urgency(scheduler_, governor_.tasks(), task, look.decision.admit,
                            look.decision.rank, governor_.plan().gives_up(task), now);
    if (loan == sched::Loan::kNone) return;
    if (loan == sched::Loan::kToHeld) {
        sched::Snapshot snapshot{now, {&self, 1}};
        snapshot.lent = true;
        look.decision = sched::decide(scheduler_, snapshot);
    }
    look.within_run_ahead = true;
    task.decision.time = nanoseconds{-1'000'000'000};  // of this launch alone
    bump(task.counters.lent);
}

}  // namespace urgengo::runtime
