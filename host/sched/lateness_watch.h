// SPDX-License-Identifier: Apache-2.0
//
// How late each chain's frames were of late, and whether there is so much to be gained that a
// comparison is worth its price (guard.h, 1). Pure: no thread, lock or clock.
#pragma once

#include <chrono>
#include <cstddef>
#include <optional>
#include <vector>

#include "host/sched/guard_mode.h"

namespace urgengo::sched {

class LatenessWatch {
  public:
    /// Of a comparison. No frame stands for more time than that, however long its period is.
    static constexpr nanoseconds kLongestWindow{2'000'000'000};
    /// With so great a mean lateness, something better is worth haste.
    static constexpr double kMuch = 0.3;

    explicit LatenessWatch(const std::vector<nanoseconds>& periods);

    void describe(std::size_t chain, nanoseconds period) { watches_[chain].period = period; }
    /// The chain's estimates contradict what is measured, or do not any more.
    void contradicts(std::size_t chain, bool they_do) { watches_[chain].contradicts = they_do; }
    /// @param ratio  latency over deadline, of a frame that was run in the settled way
    void frame_ended(std::size_t chain, double ratio, nanoseconds now);
    /// The chain's lateness is known to be another one, as it runs from now on.
    void is_at(std::size_t chain, double level) { watches_[chain].level = level; }
    /// A comparison has taken what was earned.
    void spend();

    /// @returns for how long the program has run; 0 before its first frame has ended
    nanoseconds running(nanoseconds now) const;
    /// Frames that load kernels, and choose them, are late with any scheduler.
    bool is_starting_up(nanoseconds now) const;
    /// @returns the mean over chains of the moving mean of lateness
    double level() const;
    /// @returns a few periods of most chains
    nanoseconds window() const;
    /// @returns whether frames are late, and enough of them for a comparison
    bool pays_for_comparison(nanoseconds now) const;

  private:
    struct Watch {
        nanoseconds period{0};
        int frames = 0;
        double level = 0;     ///< moving mean of lateness
        double earned_s = 0;  ///< as of last_end
        nanoseconds last_end{0};
        bool contradicts = false;
    };
    double earned_s(nanoseconds now) const;

    std::vector<Watch> watches_;
    std::optional<nanoseconds> start_;  ///< the first frame's end
    nanoseconds last_late_{0};
};

}  // namespace urgengo::sched
