// SPDX-License-Identifier: Apache-2.0
//
// How long a held launch sleeps before it looks again, so that all looks together stay cheap.
//
//  1 Place. The first few of the urgency queue look every `hold.poll_us`. A launch with more of
//    them before it has time: the more, the longer it sleeps, 2 ms at most. No launch sleeps past
//    the end of its own hold. A launch that is only paced (its own run-ahead is used up) looks as
//    often as the first: the GPU is at its work. A launch that waits for its turn at launching
//    looks every 0.5 ms, or less often: others launch the rest of their frames before it, for
//    milliseconds, and each look is a switch of threads on the cores that they need. (Eight
//    threads of a Python program, back to back, two launching at a time, two cores: 0.44 of what
//    one alone gets done with looks as in the urgency queue, 0.56 with these, 0.53 bare; simulated
//    GPU, docs/measurements.md, "Turns at Python's lock".)
//  2 Budget. What looks take is summed up over windows of 0.1 s: the time of each, and what waking
//    up costs. Above 20 % of a core the intervals are stretched, up to five times, those of the
//    first few up to four times; 2 ms stays the most. Below it they shrink again, slowly. Not more:
//    a launch that sleeps for longer than those before it need comes late, its turn is lost to the
//    GPU, so more launches wait, and sleep for longer. (With all of 48 chains stretched to
//    2 ms, 4 to 11 % of their frames were late, at 38 % load.)
//  3 End. Where that does not keep the budget for 0.3 s, no launch is held or paced for a second:
//    the GPU's priorities alone decide then. That is counted.
//
// Why: 48 chains on two cores, each looking at the 47 others every 50 us, took both cores and
// missed 3,835 of 3,840 frames (simulated GPU; without UrgenGo 0).
//
// Pure, but for atomics: it asks no clock, and any thread may call all of it.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>

namespace urgengo::sched {

using std::chrono::nanoseconds;

class PollBudget {
  public:
    static constexpr int kFirsts = 3;  ///< places that look every `poll`
    static constexpr nanoseconds kLongest{2'000'000};
    static constexpr nanoseconds kTurn{500'000};  ///< before the next look for a turn to launch
    static constexpr nanoseconds kWindow{100'000'000};
    static constexpr double kShare = 0.2;  ///< of a core, for all looks of the process
    /// What going to sleep and waking up takes of a core: a guess, not measured.
    static constexpr nanoseconds kWakeUp{4'000};
    static constexpr int kWindowsOver = 3;  ///< in a row, before holds end
    static constexpr double kMostStretch = 5, kMostStretchOfFirsts = 4;
    static constexpr nanoseconds kRest{1'000'000'000};

    /// @param poll  the shortest interval: hold.poll_us
    explicit PollBudget(nanoseconds poll) : poll_(poll) {}

    /// A held launch has slept, and has looked from `begin` to `end`.
    void looked(nanoseconds begin, nanoseconds end);

    /// @param place  of the launch in the urgency queue
    /// @param most  what is left of its hold
    /// @returns how long to sleep before the next look
    nanoseconds rest(int place, nanoseconds most) const;
    /// The same of a launch that waits for its own run-ahead alone.
    nanoseconds rest_paced(nanoseconds most) const { return rest(0, most); }
    /// The same of a launch that waits for its turn at launching.
    nanoseconds rest_for_turn(int place, nanoseconds most) const {
        return std::max(rest(place, most), std::min(kTurn, most));
    }

    /// @returns whether no launch is to be held now, as looks take too much
    bool is_over(nanoseconds now) const { return now.count() < over_until_ns_.load(kRelaxed); }
    /// @returns how often that began
    std::uint32_t num_ends() const { return num_ends_.load(kRelaxed); }
    /// @returns what looks have taken in all, up to the end of the last window
    nanoseconds total() const { return nanoseconds(total_ns_.load(kRelaxed)); }

  private:
    static constexpr auto kRelaxed = std::memory_order_relaxed;
    void adapt(double share, nanoseconds now);

    const nanoseconds poll_;
    alignas(64) std::atomic<std::int64_t> spent_ns_{0};
    std::atomic<std::int64_t> window_ns_{0};      ///< when the window at hand began; 0: none has
    alignas(64) std::atomic<double> stretch_{1};  // read at every look
    std::atomic<std::int64_t> over_until_ns_{0};
    std::atomic<std::uint32_t> num_ends_{0};
    std::atomic<std::int64_t> total_ns_{0};
    int windows_over_ = 0;  // of the thread that has ended a window: one at a time
};

}  // namespace urgengo::sched
