// SPDX-License-Identifier: Apache-2.0
//
// Which streams and events carry which task's work (work_on_streams.cpp).
//
// @threads any, each about itself
#pragma once

#include <optional>

#include "host/identity/stream_owners.h"
#include "host/progress/recorded_events.h"
#include "host/runtime/calls.h"
#include "host/runtime/runs.h"

namespace urgengo::runtime {

class WorkOnStreams {
  public:
    /// @param both  outlive it
    WorkOnStreams(Common& common, Runs& runs) : common_(common), runs_(runs) {}

    // --- launches
    /// @returns the only task that has used the stream; null: there is none
    TaskState* owner(CUstream stream) const;
    /// A launch of the task is about to be made there, by the thread that has taken it.
    void follow(TaskState& task, const Launch& launch);
    void used_by(const TaskState& task, CUstream stream) {
        if (!exec::is_default_stream(stream)) owners_.used_by(stream, task.index);
    }

    // --- events
    /// The thread has recorded it: a wait for it may be one for all that was launched.
    void recorded(ThreadState& thread, CUevent event, CUstream stream, exec::StreamFlavor flavor);
    void event_destroyed(CUevent event) { events_.forget(event); }
    /// The thread has let a stream wait for an event.
    void stream_waits(ThreadState& thread, CUstream stream, exec::StreamFlavor flavor,
                      CUevent event);

    // --- waits
    /// @returns whether this is a wait for all that the thread's task has launched; nothing if what
    ///          the thread has launched tells
    /// @param by_last  what that tells
    std::optional<bool> covers_all(ThreadState& thread, const Wait& wait, bool by_last);
    /// After it. @returns whether it still was for all
    bool covered_has_executed(ThreadState& thread, TaskState& task);

    /// The handle may come to mean another stream.
    /// @returns as exec::ProgramStreams::destroyed()
    bool destroyed(CUstream stream);

  private:
    TaskState* task_on(ThreadState& thread, CUstream stream) const;
    void forget_work_on(CUstream stream);

    Common& common_;
    Runs& runs_;
    identity::StreamOwners owners_;
    progress::RecordedEvents events_;
};

}  // namespace urgengo::runtime
