// SPDX-License-Identifier: Apache-2.0
//
// A program may jump out of a held launch (siglongjmp in a signal's handler): none of our frames
// above the handler's comes to its end. The launch was never made, so nothing is owed to the
// driver; what is left lying is ours: the task is taken, perhaps the plan, and the thread's timer
// slack is fine. The thread's next call finds that out (interposer/jumped.h), puts it right here,
// and goes on.
#include <sys/prctl.h>

#include "host/runtime/runs.h"
#include "host/sched/instance_slot.h"

namespace urgengo::runtime {

bool Runs::jumped_out_of_hold(ThreadState& thread) {
    if (!thread.at_task) return false;
    prctl(PR_SET_TIMERSLACK, 0);  // the thread's own from its start
    TaskState& task = *thread.at_task;
    common_.governor.plan().release_if_by(task);
    task.taking.held_frame = nullptr;
    common_.governor.queue().leaves(task.index);
    common_.observers.nvtx.wait_ends(task, common_.clock.now());
    if (task.slot->state.load(std::memory_order_relaxed) == abi::TaskState::kHeld)
        set_state(task, abi::TaskState::kGpu);
    thread.line.ask_again();
    release(thread);
    common_.governor.tasks().changed();
    return true;
}

void Runs::thread_ends(ThreadState& thread) {
    if (!thread.at_task) return;
    thread.at_task->taking.held_frame = nullptr;
    common_.governor.plan().release_if_by(*thread.at_task);
    release(thread);
}

}  // namespace urgengo::runtime
