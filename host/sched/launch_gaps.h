// SPDX-License-Identifier: Apache-2.0
//
// Gaps in a paced task's launching. A thread that sleeps until its run-ahead allows the next launch
// wakes up late where the cores are busy, or loses its core between two launches; a program may
// compute for a while. Beyond the run-ahead the GPU has waited for it by then. So the run-ahead is
// longer by the gaps that there are (run_ahead.h, 6).
//
//   1 What lies between two looks of a paced launch's thread, beyond what it was to sleep for and
//     beyond kUsual, is a gap.
//   2 lateness() is the gaps' mean, each weighted by its own length: what the GPU waits is in the
//     few long ones. Where gaps are less than kShare of the time it is shorter by as much. (Free
//     cores, 2: 0.2 % of the time, up to 1 ms. With a loop on each that computes 10 ms and sleeps
//     10 ms: 3 to 10 %, of 2 to 4 ms, while p99 is 0.12 ms on both; simulated GPU.)
//   3 Each time that kMemory has been looked at, what was before counts half.
//
// Only for the thread that has the task.
#pragma once

#include <algorithm>
#include <chrono>

namespace urgengo::sched {

using std::chrono::nanoseconds;

class LaunchGaps {
  public:
    static constexpr nanoseconds kUsual{200'000}, kMemory{200'000'000}, kMost{4'000'000};
    static constexpr double kShare = 0.02;

    /// @param time    between two looks
    /// @param asleep  of that, what the launch was to sleep for
    void passed(nanoseconds time, nanoseconds asleep) {
        if (total_ > kMemory) {
            total_ /= 2;
            gaps_ /= 2;
            squares_ns2_ /= 2;
        }
        total_ += time;
        const nanoseconds gap = time - asleep;
        if (gap <= kUsual) return;
        gaps_ += gap;
        squares_ns2_ += static_cast<double>(gap.count()) * static_cast<double>(gap.count());
    }

    /// @returns for how long the GPU should be able to do without the task's launches, beyond what
    ///          it should anyway
    nanoseconds lateness() const {
        if (gaps_.count() == 0) return nanoseconds{0};
        const auto gaps = static_cast<double>(gaps_.count());
        const auto total = static_cast<double>(std::max(total_, kMemory / 2).count());
        const double weight = std::min(1.0, gaps / total / kShare);
        return std::min(nanoseconds(static_cast<std::int64_t>(weight * squares_ns2_ / gaps)),
                        kMost);
    }

  private:
    nanoseconds total_{0}, gaps_{0};
    double squares_ns2_ = 0;
};

}  // namespace urgengo::sched
