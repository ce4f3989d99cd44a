// SPDX-License-Identifier: Apache-2.0
//
// Frames on their way through chains, and the instances that threads begin and end for them: told
// by hints, or by what the threads do (frames.cpp).
//
// @threads any, each about itself; takes a mutex a few times a frame
#pragma once

#include <cstdint>
#include <optional>

#include "host/identity/instances.h"
#include "host/runtime/chain_status.h"
#include "host/runtime/runs.h"

namespace urgengo::runtime {

class Frames {
  public:
    /// @param both  outlive it
    Frames(Common& common, Runs& runs);

    // Hints; see include/urgengo/urgengo.h.
    std::uint64_t arrival(ThreadState* thread, const char* chain, nanoseconds when);
    bool task_begin(ThreadState& thread, std::uint64_t instance, const char* task);  ///< exit?
    void task_end(ThreadState& thread);
    /// The thread's run, if any, is over, with or without its hint.
    void leave_task(ThreadState& thread);

    // Without hints:
    /// The thread begins an instance of the task. @returns whether it may, and no other thread has
    bool begin(ThreadState& thread, TaskState& task, nanoseconds now);
    /// Its instance is over. @param as_planned  it was what the profile says
    void end(ThreadState& thread, nanoseconds now, bool as_planned);

    identity::Instances& instances() { return instances_; }

  private:
    void dropped(const ChainState& chain);
    void finish(ChainState& chain, nanoseconds arrival, nanoseconds now);
    void end_early(ChainState& chain, nanoseconds arrival, nanoseconds short_by, nanoseconds now);
    void enter(ChainState& chain, nanoseconds arrival, nanoseconds now);
    void tell_end(const ChainState& chain, nanoseconds arrival, nanoseconds now,
                  std::optional<nanoseconds> exited_short_by = std::nullopt);
    void tell_guard(const ChainState& chain, nanoseconds latency, nanoseconds now);
    nanoseconds enter_chain(ThreadState& thread, TaskState& task, nanoseconds now);

    Common& common_;
    Runs& runs_;
    ChainStatus status_;
    identity::Instances instances_;
};

}  // namespace urgengo::runtime
