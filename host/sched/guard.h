// SPDX-License-Identifier: Apache-2.0
//
// The guard: whether scheduling helps this program, and what is done for its chains where it does
// not. Pure: told of frames with their times, asked for a mode per chain; no thread, lock or clock.
//
//                 frames are late                 better, beyond chance
//   enforce  ----------------------->  compare  ------------------------>  priorities, observe
//     ^  ^        (not too often)         |                                        |
//     |  +--------- else, and it waits twice as long before the next time ---------+ compare again,
//     +---------------------------- not worse ------------------------------------- later and later
//
// 1 It compares ways (sched/comparison.h) by lateness over deadline, the mean over chains: as
//   configured, priorities alone, nothing. It compares only where frames have been late in the last
//   10 s, and only as much as there is to be gained: lateness earns time for it. Each second in
//   which the mean lateness was L, or a single chain's was 3 L, earns L seconds; a window has to be
//   earned; what was earned a minute ago counts for a third. So a program that misses 1 % of its
//   frames is hardly ever disturbed, and one that misses half of them is helped after seconds.
//   Where estimates contradict measurement a quarter is enough; where the mean lateness is great
//   just now, less than a window. Where frames of all chains are late together, now and then
//   (sched/lateness_windows.h), windows are the longest, for the price of the usual one.
// 2 From enforce, all chains get priorities alone for the comparison; if that is neither better nor
//   worse, observe. If it is better, all fall back; if a few chains gained nearly all of it, the
//   others are given back for another comparison, and stay so unless that is worse. If it is not,
//   but one chain was much later than the others, or gained beyond chance, it may fall back alone.
//   Where much lateness is left with less, even less is compared next, without a pause.
//   Beside a busy bystander nothing is no choice, as chains have only their priorities against it:
//   chains that had fallen back to it have these meanwhile. Else, where no launch is held, that is
//   tried at once: priorities alone are all there is then.
// 3 A chain that has fallen back gets scheduling again after 10 s, then after twice as long each
//   time it fails, up to 10 minutes; the search for something better is repeated, after 2 s at
//   first where the ways were alike, and after 20 s at least where less was worse. What was
//   compared in the first seconds, perhaps of a program that was not warm yet, makes no wait longer
//   (and is repeated after 2 s, or 5 where less was worse); a comparison in which the usual way's
//   lateness has become much less than it was at its begin starts anew. At once where lateness has
//   become another than it was at the last verdict: then the program has.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "host/sched/comparison.h"
#include "host/sched/lateness_watch.h"
#include "host/sched/lateness_windows.h"

namespace urgengo::sched {

/// What the guard has made of a chain.
struct GuardedChain {
    GuardMode mode = GuardMode::kEnforce;  ///< but for comparisons
    double before = 0, after = 0;          ///< mean lateness with and without, when it was chosen
    Finding last;                          ///< of the last comparison in which it had frames
    GuardMode compared = GuardMode::kEnforce;  ///< the other way of that
};

class Guard {
  public:
    explicit Guard(const std::vector<nanoseconds>& periods);

    /// The chain's period is another one from now on.
    void describe(std::size_t chain, nanoseconds period) { watch_.describe(chain, period); }

    /// @param arrival  of the chain's frame that has just begun, or was announced
    void frame_began(std::size_t chain, nanoseconds arrival, nanoseconds deadline);
    /// @returns whether some chain's mode has changed
    bool frame_ended(std::size_t chain, nanoseconds latency, nanoseconds deadline, nanoseconds now);
    void estimates_contradict(std::size_t chain, bool they_do) {
        watch_.contradicts(chain, they_do);
    }
    /// Work of no chain keeps the GPU busy, or does not any more.
    /// @returns whether some chain's mode has changed
    bool bystanders_are_busy(bool they_are);
    /// Or no launch is held as it is: launching is scarce (policies/feasible.h, 6).
    void nobody_is_held(bool so) { nobody_is_held_ = so; }
    /// Frames will be of no use for a while: a comparison ends without a verdict.
    /// @returns whether some chain's mode has changed
    bool pause();

    GuardMode mode(std::size_t chain) const { return now_[chain]; }
    const GuardedChain& settled(std::size_t chain) const { return settled_[chain]; }
    bool is_comparing() const { return comparison_.has_value(); }
    std::size_t num_comparisons() const { return num_comparisons_; }
    std::size_t num_fallbacks() const { return num_fallbacks_; }
    /// @returns how many chains do not have what the config says
    std::size_t num_fallen() const;
    /// @returns "3 of 8 chains fell back: ..."; empty if it never found reason to
    std::string summary() const;

  private:
    enum class Aim { kLessForAll, kLessForOne, kBackForMost, kBackForAll };

    struct Trial {
        Aim aim = Aim::kLessForAll;
        int subject = Comparison::kAllChains;
        std::vector<GuardMode> other;  ///< by chain: what the settled modes are compared with
        nanoseconds began_at{0};
        double level_at_begin = 0;
    };
    struct Search {
        nanoseconds after{0};  ///< not before
        nanoseconds wait{0};   ///< and how long to wait after the next one
    };
    struct LastVerdict {
        nanoseconds at{0};  ///< 0: none yet
        double level = 0;   ///< then
    };
    /// The short one: after what was alike, or was compared while the program may not have been
    /// warm yet.
    static constexpr nanoseconds kShortWait{2'000'000'000}, kFirstWait{10'000'000'000};

    bool wants_less(nanoseconds now) const;
    GuardMode least() const {
        return beside_bystander_ ? GuardMode::kPriorities : GuardMode::kObserve;
    }
    bool explore(nanoseconds now);
    void begin(Aim aim, std::vector<GuardMode> other, int subject, nanoseconds now);
    void conclude(Verdict verdict, nanoseconds now);
    void concluded_less_for_all(Verdict verdict, const Comparison& of, nanoseconds now);
    void concluded_less_for_one(Verdict verdict, const Comparison& of, nanoseconds now);
    int lone_sufferer(const Comparison& of) const;
    std::vector<bool> few_that_gain(const Comparison& of) const;
    void settle(const Comparison& of);
    void wait_longer(Verdict verdict, nanoseconds now);
    std::vector<GuardMode> settled_modes() const;
    bool apply();

    LatenessWatch watch_;  ///< of the settled modes
    std::vector<GuardedChain> settled_;
    std::vector<GuardMode> now_;
    LatenessWindows windows_;  ///< of the settled modes

    bool beside_bystander_ = false, nobody_is_held_ = false;

    std::optional<Comparison> comparison_;
    Trial trial_;  ///< what comparison_ is for

    Search less_{{}, kShortWait};  ///< for something better
    Search back_{{}, kFirstWait};  ///< whether what has fallen back may return
    LastVerdict verdict_;
    int failed_returns_ = 0;
    std::size_t num_comparisons_ = 0, num_fallbacks_ = 0;
};

}  // namespace urgengo::sched
