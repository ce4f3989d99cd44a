// SPDX-License-Identifier: Apache-2.0
//
// Which thread has taken a task, and which has begun its run. One thread begins a run, its owner;
// helpers may launch for it. One thread at a time is at a task: a thread that finds another one
// there goes unscheduled, and never waits. The thread that lets go of the task does what is due by
// then.
//
// @threads any, each about itself
#pragma once

#include "host/runtime/gpu_segments.h"
#include "host/runtime/implicit_syncs.h"
#include "host/runtime/thread_state.h"

namespace urgengo::runtime {

class Runs {
  public:
    /// @param all of them  outlive it
    Runs(Common& common, GpuSegments& segments, ImplicitSyncs& syncs)
        : common_(common), segments_(segments), syncs_(syncs) {}

    // --- which thread has taken a task
    /// @returns whether it is the thread's now, with all launches counted: release() is due. Not if
    ///          another one is at it.
    /// @param executed  all that the task has launched is known to be over
    bool take(ThreadState& thread, TaskState& task, bool executed = false);
    /// The same of a task whose run the thread has begun. Not if that run has been ended in its
    /// place meanwhile, by `urgengo ctl` say.
    bool take_own(ThreadState& thread, TaskState& task);
    void release(ThreadState& thread);
    /// The same of a task that no launch is about.
    bool take(TaskState& task, bool executed = false);
    void let_go(TaskState& task);

    // --- whose run it is
    /// @returns the task whose run the thread has begun; null: none. (A run that its thread has
    /// left
    ///          lying may have been taken from it.)
    static TaskState* own_task(ThreadState& thread);
    /// Makes the thread the task's owner, and takes the task: begin() is due.
    /// @returns whether that was free
    bool claim(ThreadState& thread, TaskState& task);
    /// Lets go of the task, too.
    /// @param hinted  by task_begin: its CPU segment is under way
    void begin(ThreadState& thread, TaskState& task, nanoseconds arrival, nanoseconds now,
               bool hinted);
    /// The owner ends its run. A helper that is at it, held perhaps, ends it in its place.
    void end(ThreadState& thread, TaskState& task);
    /// A thread that launched once (a warm-up, say) and never again must not keep its task from
    /// others. It finds out when it comes back (own_task).
    /// By the thread that has the task: from its next launch on, this run is only looked at.
    void observe_from_here(TaskState& task, nanoseconds now);
    void end_abandoned(ThreadState& thread, TaskState& task, nanoseconds now);
    /// UrgenGo is off: no run is under way any more. Where a thread is at a task, it ends the run
    /// as it lets go. The owners find out when they come back (own_task).
    void end_all();
    /// The same of one chain.
    void end_all(const ChainState& chain);
    /// The owner's call that waited for all GPU work is over.
    void sync_ended(TaskState& task);

    /// The task waits for work of another one, which becomes as urgent.
    /// @param until  GPU time that the other one had launched by then
    /// @param holds_back  what the task launches from now on is behind that work; else it only asks
    void lend_along(TaskState& task, TaskState& waited_for, nanoseconds until,
                    bool holds_back = true);

    // --- who does not come back (recovery.cpp)
    /// The thread has jumped out of a hold. @returns whether it was in one
    bool jumped_out_of_hold(ThreadState& thread);
    /// The thread ends, perhaps cancelled inside a call.
    void thread_ends(ThreadState& thread);

  private:
    nanoseconds served_deadline(ThreadState& thread, nanoseconds own, nanoseconds now) const;
    void finish_due(TaskState& task);
    void end_taken(TaskState& task);
    void forget_streams(TaskState& task);

    Common& common_;
    GpuSegments& segments_;
    ImplicitSyncs& syncs_;
};

}  // namespace urgengo::runtime
