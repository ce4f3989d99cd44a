// SPDX-License-Identifier: Apache-2.0
//
// The program's waits and events (waits.cpp), and its calls that wait for all GPU work.
//
// @threads any, each about itself
#pragma once

#include "host/exec/cheap_waits.h"
#include "host/runtime/resolver.h"

namespace urgengo::runtime {

class Waits {
  public:
    /// All outlive it.
    struct Around {
        GpuSegments& segments;
        ImplicitSyncs& syncs;
        Runs& runs;
        Frames& frames;
        WorkOnStreams& streams;
        Resolver& resolver;
    };
    /// @param sleep  waits sleep (exec/cheap_waits.h)
    Waits(Common& common, const Around& around, bool sleep);

    /// Before a call that waits: what the thread launched on its stream is marked.
    void before(ThreadState& thread, Wait& wait);
    /// Between the two: sleeps until that wait is (nearly) over, if the config asks for it. The
    /// program's own call still says how it ended.
    void sleep_through(ThreadState& thread, const Wait& wait) const;
    bool are_slept_through() const { return cheap_.are_on(); }
    /// After it; if it waited for all that the task launched, its GPU segment has ended.
    void after(ThreadState& thread, const Wait& wait, bool succeeded);

    /// The thread has recorded an event on a stream: a wait for it may be one for all that was
    /// launched. Between two events that take the time (`timed`), around a single launch, comes
    /// nothing of ours.
    void event_recorded(ThreadState& thread, CUevent event, CUstream stream,
                        exec::StreamFlavor flavor, bool timed);

    /// Around a call that waits for all work that the context has launched (cuMemFree, say): tasks
    /// that are less urgent than this thread's launch nothing that could delay it.
    /// The thread waits no more, and nothing has ended by that.
    void wait_is_left(ThreadState& thread);
    void implicit_sync_begins(ThreadState& thread);
    void implicit_sync_ended(ThreadState& thread);

  private:
    void mark_before(ThreadState& thread, TaskState& task, const Wait& wait, bool by_streams);

    Common& common_;
    const Around around_;
    const exec::CheapWaits cheap_;
};

}  // namespace urgengo::runtime
