// SPDX-License-Identifier: Apache-2.0
//
// Whether a task's launching is slowed down by other tasks' launching: they share an interpreter's
// lock, another lock, or too few cores. A few at a time then get as much done as all of them, and
// each sooner (scheduler.launchers, sched/admission.cpp). Eight eager PyTorch networks in threads
// of one process, at 0.9 of what they can do, phases of 6 s in turns, two seeds, H100: 0.0 and 0.0
// % missed with two or three at a time, 3.7 and 1.2 where UrgenGo only observes, 50 and 82 with
// one. And once all take turns of Python's lock after each operation, all are late together, for
// seconds: bare, five processes' first 8 s, 11 to 85 %.
//
//  1 An instance tells how long it took to launch, from each segment's first launch to the wait for
//    it, less what it was held and paced; and beside whom: the share of its marks at which as many
//    others were launching as are let, so that with it there were more.
//  2 With others beside it for half of the time or more, that is a sample of the slow-down; with
//    hardly any, free or not, one of the task's own pace. The last kRecent of each count, by their
//    median; of the pace, by the lower quartile, since what delays a thread only lengthens. (Once
//    most were free, and those were not counted, what they all took beside each other was taken for
//    their paces alone: 1.5 to 2.2 of seven traced networks, which so seemed to be slowed down by
//    1.1 to 1.4 only; H200, 2026-11-28.)
//  3 Free below kFreeBelow. Slowed from kSlowedFrom on, if turns cost nothing: if those that launch
//    together get no more done than about one alone (kSerialUpTo), as where all need one lock. n
//    that take s times as long get n/s done, free ones among them: eight eager networks 0.7 to 1.3,
//    seven traced ones 1.4 to 2.3. With turns these missed 16 % of their frames on a loud machine,
//    without turns 6, and bare 4 (H100, docs/measurements.md). Parallel from kParallelFrom on. In
//    between it stays what it was. A slowed task waits for others that may need the same lock,
//    not for free ones, nor for parallel ones, which gain next to nothing by that. (Beside a
//    bystander, which slows all launching down, two of seven traced networks, the others parallel,
//    got 1.1 and 1.4 done, 1.7 and 2.2 without it: slowed. They waited for the others for 5.0 and
//    4.2 s of 30, and all seven missed 10.3 % of their frames, by priorities alone 6.2; H200,
//    2026-11-28.)
//  4 A program may launch with its lock held: then a held task keeps the others from launching.
//    After kInVain holds in a row that ended as those before it paused, and during which none of
//    the others got on, it is free until kRetry. (Where all take turns of Python's lock each pauses
//    for a millisecond now and then: without the second condition one to three of eight eager
//    networks were soon free in each process, and kept that state up; H100, 2026-11-26.)
//  5 Plans reckon with the pace that a task usually has, of the last kRecent, beside others or not,
//    by their lower quartile, if that is slower than alone by kFreeBelow. Else tasks that others
//    slow down were held for a GPU that had room, as each took less of it than by its pace alone.
//    Not where turns are taken: these give back the pace alone.
//  6 A slowed task is scheduled so that this is not seen any more. So after kRetry it is forgotten,
//    and found out again; each time that it was so, after twice as long.
//
// Pure; the task's owner only.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>

#include "urgengo/abi/shared_page.h"

namespace urgengo::model {

using abi::Launching;
using std::chrono::nanoseconds;

constexpr const char* to_string(Launching launching) {
    return launching == Launching::kSlowed     ? "slowed"
           : launching == Launching::kFree     ? "free"
           : launching == Launching::kParallel ? "parallel"
                                               : "unknown";
}

/// @returns whether one that is slowed may wait for others of this kind
constexpr bool may_need_same_lock(Launching other) {
    return other != Launching::kFree && other != Launching::kParallel;
}

class LaunchContention {
  public:
    static constexpr std::size_t kRecent = 8, kFirst = 4;
    static constexpr std::size_t kTogetherRecent = 32, kTogetherFirst = 12;
    static constexpr int kInVain = 3;
    static constexpr double kSlowedFrom = 1.4, kFreeBelow = 1.2;
    static constexpr double kSerialUpTo = 1.3, kParallelFrom = 1.5;
    static constexpr nanoseconds kRetry{20'000'000'000}, kMostRetry{600'000'000'000};
    /// What takes less to launch tells too little.
    static constexpr nanoseconds kLeastTime{500'000};

    struct Instance {
        nanoseconds took{0};   ///< to launch all of it
        nanoseconds alone{0};  ///< the same by the profile
        int marks = 0;         ///< at each it was counted which others launch
        int beside = 0;        ///< of those, with as many others as may
        int others = 0;        ///< the others, of all marks
        int free = 0;          ///< the same of those that are free, which slow it down, too
        bool unknown = false;  ///< there were tasks of which no mark tells whether they launch
    };

    void observe(const Instance& instance, nanoseconds now);
    /// A hold of a launch, for others that launched, has ended.
    /// @param in_vain  they paused, and none of them got on while this task was held: so it may be
    ///                 its thread that has what they need
    void held(bool in_vain, nanoseconds now);
    Launching verdict() const { return verdict_; }
    /// @returns by which the profile's launch times are to be multiplied, usually; 0.5..4
    double pace() const { return pace_; }
    /// @returns whether that is so much slower than alone that others' launching is why
    bool is_contended() const { return pace_ >= kSlowedFrom * alone_pace_; }
    /// @returns whether they are known to get more done together than one alone: they share more
    ///          than one lock. An interpreter's threads do not.
    bool is_parallel() const {
        return verdict_ != Launching::kSlowed &&
               (verdict_ == Launching::kFree || together_ > kSerialUpTo);
    }
    /// @returns how many times as long it took beside others that launch; 0: not seen
    double slowdown() const { return slowdown_; }
    /// @returns how much of their launching they get done together, in what one gets done alone;
    ///          0: not seen
    double together() const { return together_; }

  private:
    template <std::size_t kSize>
    struct Samples {
        std::array<double, kSize> values{};
        std::size_t count = 0;
        void add(double value) { values[count++ % kSize] = value; }
        /// @param share  0.5: the median
        double quantile(double share) const;
    };

    void judge(nanoseconds now);
    void find_pace();

    Samples<kRecent> beside_, alone_, usual_;
    Samples<kTogetherRecent> done_;
    double alone_pace_ = 1, pace_ = 1, slowdown_ = 0, together_ = 0;
    Launching verdict_ = Launching::kUnknown;
    nanoseconds found_{0}, retry_{kRetry}, rests_until_{0};
    int in_vain_ = 0;
};

}  // namespace urgengo::model
