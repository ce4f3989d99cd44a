// SPDX-License-Identifier: Apache-2.0
//
// Without hints: when a thread's next frame has arrived, by what the thread has done since its last
// wait for the GPU. A frame has arrived as long before its first call as the thread has computed
// since then; a thread that has not slept meanwhile is behind, and its frame has arrived a period
// after the one before.
//
// The thread's own.
#pragma once

#include <algorithm>
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

    /// A thread off the CPU for less than this between two instances did not wait for its next
    /// frame.
    static constexpr nanoseconds kNotAsleep{500'000};

    /// The same of any thread. Pure.
    /// @param end  of its last wait; 0: there was none
    /// @param cpu  time that it has computed since then
    static Frame frame_of(const sched::GovernedChain& chain, nanoseconds end, nanoseconds cpu,
                          nanoseconds now) {
        if (end.count() == 0) return {.arrival = now};
        const bool slept = now - end - cpu > kNotAsleep;
        const nanoseconds arrival = now - cpu;
        const nanoseconds last(chain.last_arrival_ns.load(std::memory_order_relaxed));
        // Behind: this frame was due before the thread was done with the last one. But not by more
        // than makes a difference.
        if (last.count() == 0 || slept || end <= last + chain.period())
            return {.arrival = arrival, .slept = slept};
        const nanoseconds due = std::max(last + chain.period(), now - 2 * chain.longest());
        return {.arrival = std::min(arrival, due), .slept = slept};
    }

  private:
    nanoseconds end_{0};
    std::uint32_t end_cpu_us_ = 0;
};

}  // namespace urgengo::identity
