// SPDX-License-Identifier: Apache-2.0
//
// When a thread's last wait for the GPU ended, and what it has computed since then: without hints
// that says when its next frame has arrived (sched/backlog.h).
//
// The thread's own.
#pragma once

#include <chrono>
#include <cstdint>

#include "host/sched/backlog.h"

namespace urgengo::identity {

using std::chrono::nanoseconds;

class LastWait {
  public:
    void ended(nanoseconds now);
    /// @returns when it ended; 0: there was none
    nanoseconds end() const { return end_; }
    /// @returns time that the thread has computed since then; all of it, where that makes no
    ///          difference for a frame of the chain
    nanoseconds computed(const sched::GovernedChain& chain, nanoseconds now) const;
    /// @returns whether the thread has slept since then, for long enough that it waited for a frame
    bool has_slept(nanoseconds computed, nanoseconds now) const {
        return end_.count() != 0 && now - computed - end_ > sched::Backlog::kNotAsleep;
    }
    /// @param chain  whose frame the thread begins with now
    /// @returns when that has arrived
    nanoseconds begin_frame(const sched::GovernedChain& chain, nanoseconds computed,
                            nanoseconds now) {
        return backlog_.begin_frame(chain, end_, computed, now);
    }

  private:
    nanoseconds end_{0};
    std::uint32_t end_cpu_us_ = 0;
    sched::Backlog backlog_;
};

}  // namespace urgengo::identity
