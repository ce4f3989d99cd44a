// SPDX-License-Identifier: Apache-2.0
//
// Are frames less late one way than another? Pure: no thread, lock or clock.
//
// 1 Windows. The two ways, "usual" and "other", take turns of a window's length: usual, other,
//   other, usual, usual, other, ... so that what drifts meanwhile cancels out. A window begins and
//   ends with the end of some frame.
// 2 Frames. A frame counts for a window if it has arrived and ended in it (or in the windows of the
//   same way right before). The first frame of each chain after a switch is dropped: it meets what
//   was launched before. One that is late already when the window ends counts as it is. A chain
//   that has fallen behind has frames that arrived long before: they count from the end of the one
//   before.
// 3 Differences. After each pair of windows every chain with a few frames in both gives a
//   difference of means; one that has fewer keeps them for the next pair. The pair's difference is
//   the mean over those chains.
// 4 Verdict. Student's t of the pairs' differences, one-sided at 0.5 %, looked at from the third
//   pair on, and an effect that is worth it; or two pairs, where both show one of 0.35 or more.
//   Under no true difference that calls the other way better in 0 to 2.5 % of comparisons
//   (test_guard.cpp). To stay takes less: from the second pair on worse beyond the spread, from the
//   fourth on worse by what is worth it; and where the other way is to schedule less, worse by 0.1
//   in the first pair that gives a difference, in which those of its frames are missing that are
//   neither over nor late yet. Not where it is to schedule more, as its first frames meet what the
//   usual way has left. Where neither is shown by then, and half of what is worth
//   it is not either, or the mean loses as much, both are alike.
// 5 A window of the other way ends early, and the comparison with it, as soon as its frames are
//   clearly later than the usual: exploring costs a few frames, not a window's. Where frames of all
//   chains are late together, now and then, the usual way has such windows as well: there the other
//   way's have to be worse than the worst of them.
#pragma once

#include <cstddef>
#include <vector>

#include "host/sched/guard_mode.h"

namespace urgengo::sched {

/// Of a series of numbers.
class Series {
  public:
    void add(double x);
    std::size_t size() const { return n_; }
    double mean() const { return n_ ? mean_ : 0; }
    double greatest() const { return greatest_; }
    /// @returns Student's t of the mean against 0; the spread counts as kLeastSpread or more
    double t() const;
    /// @returns of the mean, by how much it may be off either way, with 95 %; from two numbers on
    double margin() const;
    /// One-sided at 0.5 %, from three numbers on.
    bool is_below_zero() const;
    bool is_above_zero() const;

  private:
    double error() const;  ///< standard error of the mean

    std::size_t n_ = 0;
    double mean_ = 0, squares_ = 0, greatest_ = 0;
};

/// Mean lateness of a chain both ways, and how sure the difference is.
struct Finding {
    std::size_t pairs = 0;  ///< of windows that gave a difference
    double usual = 0, other = 0;
    double low = 0, high = 0;  ///< of other - usual, 95 %; from two pairs on
};

enum class Verdict { kOpen, kBetter, kWorse, kAlike };

class Comparison {
  public:
    static constexpr int kAllChains = -1;
    /// A smaller difference of mean lateness is not worth a change.
    static constexpr double kWorthIt = 0.03;

    /// @param subject  the chain that is to gain, while the mean over all does not lose; or
    ///                 kAllChains: the mean is to gain
    /// @param other_is_less  it schedules less than the usual way, which is to stay where in doubt
    /// @param worst    0, or where many frames are late together, now and then: the sum of lateness
    ///                 in the worst of the usual way's windows before
    Comparison(std::size_t num_chains, int subject, nanoseconds window, nanoseconds now,
               bool other_is_less, double worst = 0);

    bool other_is_on() const { return other_is_on_; }
    /// So that a frame that does not end counts, too.
    void frame_began(std::size_t chain, nanoseconds arrival, nanoseconds deadline);
    /// May switch to the other way, or back.
    Verdict frame_ended(std::size_t chain, nanoseconds arrival, nanoseconds deadline,
                        nanoseconds now);

    /// @returns mean lateness of the chain's frames; 0 if none has ended
    double usual(std::size_t chain) const { return chains_[chain].total[0].mean(); }
    double other(std::size_t chain) const { return chains_[chain].total[1].mean(); }
    /// The mean over chains that had frames both ways.
    double usual() const { return mean_of(0); }
    double other() const { return mean_of(1); }
    Finding finding(std::size_t chain) const;
    /// @returns whether the other way is better, or worse, for this chain beyond chance
    bool gains(std::size_t chain) const;
    bool loses(std::size_t chain) const;

  private:
    struct Chain {
        int ended = 0;          ///< frames since the switch
        bool may_count = true;  ///< one of them had arrived after it
        nanoseconds last_end{0};
        nanoseconds open{-1};  ///< arrival of a frame that has not ended; below 0: none
        nanoseconds deadline{1};
        Series window;     ///< lateness of its frames in the window at hand
        Series pooled[2];  ///< the same, both ways, since its last difference
        Series total[2];
        Series differences;
    };
    double mean_of(int way) const;
    double gain_of(std::size_t chain) const;
    bool is_late_already(const Chain& chain, nanoseconds now) const;
    bool is_much_later(nanoseconds now) const;
    void end_window(nanoseconds now);
    void end_pair();
    Verdict verdict() const;

    const nanoseconds window_;
    const int subject_;
    const bool other_is_less_;
    std::vector<Chain> chains_;
    Series differences_;  ///< of pairs
    double worst_;        ///< sum of lateness in the usual way's windows, at most; 0: not to tell
    /// In the window at hand, so many times as each frame took deadlines: what piles up is soon
    /// more than the worst of the usual way's, in which each counts once.
    double late_ = 0;
    int num_windows_ = 0;
    bool other_is_on_ = false;
    nanoseconds window_start_;
    nanoseconds way_start_{0};  ///< of the windows of the same way in a row; at first, long ago
};

}  // namespace urgengo::sched
