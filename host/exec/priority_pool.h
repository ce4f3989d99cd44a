// SPDX-License-Identifier: Apache-2.0
//
// The paper's stream replacement, for drivers that ignore the priority of a launch and of a stream
// in use: the kernel runs on a stream of ours that was made with the wished priority.
//
// Order is that of the program's own stream by construction, whatever else is put there: the kernel
// waits for an event recorded on the program's stream (all that was there), and the program's
// stream waits for an event recorded behind the kernel (so does all that comes). Nothing else has
// to be intercepted: copies, events, host functions, queries and waits on the program's stream find
// the kernel's end in it. The price is two records and two waits a launch.
//
// Not for launches that depend programmatically on the one before, nor for streams that capture:
// those keep the program's stream. Stream attributes other than the priority stay behind.
//
// One PriorityPool a thread; it makes its streams in the contexts that it meets, at most eight.
#pragma once

#include <array>

#include "host/exec/progress_marks.h"

namespace urgengo::exec {

class PriorityPool {
  public:
    explicit PriorityPool(const DriverApi& driver) : driver_(driver) {}
    ~PriorityPool() = default;  // the streams go with their contexts: work may be under way

    /// Launches on a stream of the wished priority instead of the program's.
    /// @param context  the current one
    /// @param launch   (CUstream) -> CUresult: on that stream; called exactly once
    template <typename Launch>
    CUresult launch(const MarkContext& context, int priority, CUstream stream, StreamFlavor flavor,
                    Launch&& launch) {
        Lane* lane = fork(context, priority, stream, flavor);
        const CUresult result = launch(lane ? lane->stream : stream);
        if (lane) join(*lane, stream, flavor);
        return result;
    }

  private:
    static constexpr int kMaxContexts = 8;
    static constexpr int kMaxLevels = 8;

    struct Lane {
        CUstream stream = nullptr;
        CUevent before = nullptr, behind = nullptr;
        bool refused = false;
    };
    struct Lanes {
        unsigned long long context = 0;
        std::array<Lane, kMaxLevels> by_level{};
    };

    Lane* fork(const MarkContext& context, int priority, CUstream stream, StreamFlavor flavor);
    void join(const Lane& lane, CUstream stream, StreamFlavor flavor) const;
    bool make(Lane& lane, int priority) const;

    const DriverApi& driver_;
    std::array<Lanes, kMaxContexts> contexts_{};
    int num_contexts_ = 0;
};

}  // namespace urgengo::exec
