// SPDX-License-Identifier: Apache-2.0
//
// The program's streams: which are being captured, whose priorities are lent, which graphs run at
// them, and which streams of ours stand in for them. They come and go with streams, contexts and
// threads, told here.
//
// @threads any
#pragma once

#include "host/exec/captures.h"
#include "host/exec/graph_priorities.h"
#include "host/exec/priority_pool.h"
#include "host/exec/stream_priorities.h"
#include "host/sched/tasks.h"

namespace urgengo::exec {

class ProgramStreams {
  public:
    /// @param driver, tasks  outlive it
    ProgramStreams(const DriverApi& driver, sched::Tasks& tasks)
        : driver_(driver),
          tasks_(tasks),
          captures_(driver),
          priorities_(driver),
          graphs_(driver),
          pool_(driver) {}

    const Captures& captures() const { return captures_; }
    StreamPriorities& priorities() { return priorities_; }
    GraphPriorities& graphs() { return graphs_; }
    PriorityPool& pool() { return pool_; }
    bool is_capturing(CUstream stream, StreamFlavor flavor) const {
        return captures_.is_capturing(stream, flavor);
    }

    /// A capture that begins on this stream is about to, or has ended: with whatever result ends
    /// one, or with the stream. (One that ends with its context or its thread has: context_ended(),
    /// thread_ends().)
    void capture_begins(CUstream stream, StreamFlavor flavor) {
        priorities_.restore(stream, flavor);  // the graph copies it
        captures_.began(stream, flavor);
        tasks_.changed();
    }
    /// By a call that is not seen to end: if it is refused, it counts all the same, once.
    void capture_may_begin(CUstream stream, StreamFlavor flavor) {
        if (captures_.began_on(stream_key(driver_, stream, flavor)))
            priorities_.restore(stream, flavor);
        else
            capture_begins(stream, flavor);
    }
    void capture_ended(CUstream stream, StreamFlavor flavor) {
        captures_.ended(stream_key(driver_, stream, flavor));
    }

    /// The handle may come to mean another stream.
    /// @returns whether a capture began there: capture_ended() is due when the stream is gone
    bool destroyed(CUstream stream) {
        priorities_.forget(stream);
        pool_.forget({stream, nullptr});
        return captures_.began_on({stream, nullptr});
    }
    /// Some context goes, or may go, with its streams.
    void context_ends() { priorities_.forget(nullptr); }
    void context_ended() { captures_.context_ended(); }
    /// The calling thread does, with its per-thread default stream.
    void thread_ends() {
        captures_.thread_ends();
        pool_.forget(stream_key(driver_, CU_STREAM_PER_THREAD, StreamFlavor::kPerThread));
    }

  private:
    const DriverApi& driver_;
    sched::Tasks& tasks_;
    Captures captures_;
    StreamPriorities priorities_;
    GraphPriorities graphs_;
    PriorityPool pool_;
};

}  // namespace urgengo::exec
