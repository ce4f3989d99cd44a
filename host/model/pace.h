// SPDX-License-Identifier: Apache-2.0
//
// How fast a task gets on: GPU time that passes per estimated GPU time of its kernels. 1 where they
// have the GPU as they had it in the profile, more where others share it with them. For position.h:
// without it, where the GPU is between two marks is thought too far ahead whenever it is shared.
//
// From what lies between two marks that were seen executed: a span begins at its first mark, or
// when what follows that was launched, if later. Spans count by their work, for half at kHalf.
// Alone, and beside others on the GPU, are two paces, and what was learned of the one says nothing
// about the other.
//
// Any thread may tell of a mark; one that comes while another is at it goes away. Readers never
// wait.
#pragma once

#include <array>
#include <atomic>

#include "host/model/position.h"

namespace urgengo::model {

class Pace {
  public:
    /// Work that counts for half.
    static constexpr nanoseconds kHalf{100'000};

    /// A mark was seen executed.
    /// @param mark    with the time at which it ran
    /// @param shared  others are on the GPU
    void saw(const LaunchLog& log, const SeenMark& mark, bool shared);

    /// @returns GPU time per estimated GPU time, within kMinPace and kMaxPace
    double value(bool shared) const {
        return static_cast<double>(pace_[shared ? 1 : 0].load(std::memory_order_relaxed));
    }
    /// @returns what to expect of the work at hand: half of what the last spans were off by. The
    ///          co-runners change from one kernel to the next. (Ten chains on the simulated
    ///          GPU: with the half, position and remaining work are off least, and not to one
    ///          side.)
    double expected(bool shared) const { return (1 + value(shared)) / 2; }

  private:
    std::atomic_flag busy_ = ATOMIC_FLAG_INIT;
    bool is_known_ = false;  // there is a last one
    SeenMark last_;
    std::array<std::atomic<float>, 2> pace_{1.F, 1.F};
};

}  // namespace urgengo::model
