// SPDX-License-Identifier: Apache-2.0
//
// Without hints: when a thread's next frame has arrived, by what the thread has done since its last
// wait for the GPU. A frame has arrived as long before its first call as the thread has computed
// since then; a thread that has not slept meanwhile is behind, and its frame has arrived a period
// after the one before.
//
// The thread's own.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>

#include "host/sched/governed.h"

namespace urgengo::identity {

using std::chrono::nanoseconds;

class LastWait {
  public:
    struct Frame {
        nanoseconds arrival{0};
        bool slept = false;  ///< for long enough that the thread was waiting for it
    };

    void ended(nanoseconds now);
    /// @returns when it ended; 0: there was none
    nanoseconds end() const { return end_; }
    /// @param chain  whose frame the thread begins with now
    Frame next_frame(const sched::GovernedChain& chain, nanoseconds now) const;

  private:
    nanoseconds end_{0};
    std::uint32_t end_cpu_us_ = 0;
};

}  // namespace urgengo::identity
