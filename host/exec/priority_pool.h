// SPDX-License-Identifier: Apache-2.0
//
// The paper's stream replacement, for drivers that ignore the priority of a launch and of a stream
// in use: the kernel runs on a stream of ours that was made with the wished priority, a lane.
//
// Order is that of the program's own stream by construction, whatever else is put there: the kernel
// waits for an event recorded on the program's stream (all that was there), and the program's
// stream waits for an event recorded behind the kernel (so does all that comes). Nothing else has
// to be intercepted: copies, events, host functions, queries and waits on the program's stream find
// the kernel's end in it. The price is two records and two waits a launch.
//
// Every stream of the program has lanes of its own, one for each priority: on a shared one, a
// kernel would wait for another stream's, which may wait for it. Those of a stream that has gone
// are another's of the same context once nothing is on them any more.
//
// Not for launches that depend programmatically on the one before, nor for streams that capture:
// those keep the program's stream. Stream attributes other than the priority, and the part of the
// GPU that a green context's stream is confined to, stay behind.
//
// Threads: any. The lock is held to find a lane, not while something is put on one.
#pragma once

#include <deque>
#include <mutex>

#include "host/exec/progress_marks.h"
#include "host/exec/stream_key.h"

namespace urgengo::exec {

class PriorityPool {
  public:
    struct Lane {
        CUstream stream = nullptr;
        CUevent before = nullptr, behind = nullptr;
    };

    explicit PriorityPool(const DriverApi& driver) : driver_(driver) {}

    /// Before a launch on the lane's stream instead of the program's.
    /// @param context  the current one
    /// @returns null if the launch has to go as it came; else join() is due after it, whether it
    ///          succeeded or not
    const Lane* fork(const MarkContext& context, int priority, CUstream stream,
                     StreamFlavor flavor);
    void join(const Lane& lane, CUstream stream, StreamFlavor flavor) const;

    /// The program's stream goes.
    void forget(const StreamKey& key);
    /// A context has gone, with its lanes.
    void context_ended(unsigned long long id);

  private:
    static constexpr std::size_t kMaxLanes = 256;  ///< at a time

    struct Entry {
        unsigned long long context = 0;  ///< 0: there is no lane
        StreamKey key{};
        bool is_owned = false;  ///< by the stream of that key
        int priority = 0;
        Lane lane;
        bool refused = false;
    };

    const Lane* find_or_make(const MarkContext& context, int priority, const StreamKey& key);
    bool make(Lane& lane, int priority) const noexcept;
    bool exists(CUstream stream) const;
    bool is_idle(const Lane& lane) const;
    Entry* unused(const MarkContext& context, int priority);

    const DriverApi& driver_;
    std::mutex mutex_;
    std::deque<Entry> lanes_;  // never fewer: a thread may have one
    bool told_ = false;        // that there would be more
};

}  // namespace urgengo::exec
