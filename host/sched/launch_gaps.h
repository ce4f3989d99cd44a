// SPDX-License-Identifier: Apache-2.0
//
// Gaps in a paced task's launching. A thread that sleeps until its run-ahead allows the next launch
// wakes up late where the cores are busy, or loses its core between two launches. Beyond the
// run-ahead the GPU has waited for it by then. So the run-ahead is longer by the gaps that there
// are (run_ahead.h, 6).
//
//   1 A gap is the time between two looks of the task's launches that is longer than the run-ahead,
//     without what the first one was to sleep for. It counts once a launch of the GPU segment at
//     hand was paced, until one is held, stands behind a gate, goes unasked, or the thread waits in
//     a call: such time is not the cores'.
//   2 lateness() is the gaps' mean, each weighted by its own length: what the GPU waits is in the
//     few long ones. Where gaps are less than kShare of the time it is shorter by as much. (Free
//     cores, 2: 0.2 % of the time, up to 1 ms. With a loop on each that computes 10 ms and sleeps
//     10 ms: 3 to 10 %, of 2 to 4 ms, while p99 is 0.12 ms on both; simulated GPU.)
//   3 With each kMemory that passes, what was before counts half, also while the task is not paced:
//     a few seconds after the cores are free, or after one long stop, the run-ahead is what it was
//     before.
//
// Only for the thread that has the task.
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>

namespace urgengo::sched {

using std::chrono::nanoseconds;

class LaunchGaps {
  public:
    static constexpr nanoseconds kMemory{250'000'000};
    /// Of looking that shares are of, at least.
    static constexpr nanoseconds kLeast{20'000'000};
    static constexpr int kMost = 4;  ///< lateness(), in run-aheads
    static constexpr double kShare = 0.02;

    /// A launch has slept for that long, as it was told, since the last look.
    void slept(nanoseconds time) { total_ns_ += static_cast<double>(time.count()); }
    /// The time between two looks, but for what the launch was to sleep for.
    void passed(nanoseconds time, nanoseconds run_ahead, nanoseconds now) {
        const double keeps = fading(now);
        total_ns_ *= keeps;
        gaps_ns_ *= keeps;
        squares_ns2_ *= keeps;
        last_ = now;
        const auto gap =
            static_cast<double>(std::clamp(time, nanoseconds{0}, kMost * run_ahead).count());
        total_ns_ += gap;
        if (time <= run_ahead) return;
        gaps_ns_ += gap;
        squares_ns2_ += gap * gap;
    }

    /// @returns how much longer the GPU should be able to do without the task's launches than for
    ///          the run-ahead: kMost of those at most
    nanoseconds lateness(nanoseconds now) const {
        if (gaps_ns_ == 0) return nanoseconds{0};
        const double keeps = fading(now);
        const double total = std::max(keeps * total_ns_, static_cast<double>(kLeast.count()));
        const double weight = std::min(1.0, keeps * gaps_ns_ / total / kShare);
        return nanoseconds(static_cast<std::int64_t>(weight * squares_ns2_ / gaps_ns_));
    }

  private:
    double fading(nanoseconds now) const {
        return std::exp2(-static_cast<double>((now - last_).count()) /
                         static_cast<double>(kMemory.count()));
    }

    nanoseconds last_{0};  ///< when something passed
    double total_ns_ = 0, gaps_ns_ = 0, squares_ns2_ = 0;
};

}  // namespace urgengo::sched
