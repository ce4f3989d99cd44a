// SPDX-License-Identifier: Apache-2.0
//
// How late frames were of late, window by window: so that a comparison (sched/comparison.h) knows
// whether they are late one by one, or many together, now and then. Where a machine stalls each
// half second, a window of half a second says little, and one stall is no proof that a way is
// worse.
//
// Pure; one thread at a time.
#pragma once

#include <array>
#include <cstddef>

#include "host/sched/guard_mode.h"

namespace urgengo::sched {

class LatenessWindows {
  public:
    bool is_over(nanoseconds now) const { return now - begin_ >= length_; }
    void next(nanoseconds now, nanoseconds length);
    void add(double lateness) { sum_ += lateness; }
    /// What is under way is not to count: the window begins anew.
    void skip(nanoseconds now) {
        begin_ = now;
        sum_ = 0;
    }

    /// @returns whether many frames are late together, now and then
    bool are_uneven() const;
    /// @returns the lateness of all frames in so many windows in a row, at most
    double worst(std::size_t in_a_row) const;

  private:
    static constexpr std::size_t kKept = 16, kFew = 6;

    nanoseconds begin_{0}, length_{0};
    double sum_ = 0;
    std::array<double, kKept> last_{};
    std::size_t count_ = 0;
};

}  // namespace urgengo::sched
