// SPDX-License-Identifier: Apache-2.0
//
// Bystanders: work of no chain that keeps the GPU busy. A bystander is never held, so the GPU time
// that chains give up by holds and pacing goes to it. Beside a busy bystander no launch is held for
// lack of room, run-ahead is not bounded, nothing is learned of how long work takes, and priorities
// alone order the chains.
//
//  1 A bystander's launches are not counted one by one: the first one sets a flag. The next look at
//    the GPU's tasks reads and clears it, once a window, or after several without a look. A
//    bystander launches often from kBusy of the windows on, and until it is in less than kIdle of
//    them.
//  2 A bystander that hardly slows chains down does not count, however often it launches. Instances
//    that shared the GPU with it alone tell (`measured_ns / expected_ns`): kEnough of them, the
//    last one less than kStale ago, all while it launched often. Until they have told, it counts as
//    one that slows them down: chains may never be alone with it, and what was measured beside
//    another bystander, such as the one that builds a program's networks, says nothing of this one.
//  3 Some kernels are longer than what a bystander puts between two launches of a task that is
//    alone with it. They are held as ever: an urgent chain of short kernels would have them in its
//    gaps instead of the bystander's, and the GPU's priorities cannot help. But what is held leaves
//    the GPU to the bystander, and plans know the time alone. So of kernels that are not very long
//    a task's are held only while it has kSpare times as much time to spare as it takes longer
//    beside the bystander. (Without that two of seven networks with kernels 2.1 times as long as
//    the bystander's missed 16 and 19 % of their frames, with it 2 and 3; all seven 8.8 and 4.2 %,
//    by priorities alone 4.1. Simulated GPU; docs/measurements.md, "Mixes of real networks".)
//  4 Nor can plans go by the time alone in the order of the chains: each kernel waits for a part of
//    the bystander's, so of those that are in time the one goes first that has to go on first, as
//    things are beside it (SlotView::longer_beside; policies/feasible.h, 7).
//  5 Tasks that slow each other's launching to a half launch in turn as ever
//    (model/launch_contention.h): what they wait for is not the GPU. Less than that may be.
//
// @threads any
// @source Beside a back-to-back thread of no chain, seven traced networks at load 0.5 missed 12.6 %
//         held, 3.2 % with priorities alone, 7.9 % bare (H100, 07f4294).
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>

namespace urgengo::sched {

using std::chrono::nanoseconds;

class Bystanders {
  public:
    static constexpr nanoseconds kWindow{5'000'000};
    static constexpr float kBusy = 0.5F, kIdle = 0.2F;
    /// Of windows: a busy bystander is noticed after 50 ms.
    static constexpr float kGain = 1.0F / 12;
    static constexpr float kSlowed = 1.15F;
    static constexpr int kEnough = 3;
    static constexpr int kStale = 1000;  ///< windows: 5 s
    /// Times what a bystander takes between two launches: from there on a kernel is long.
    static constexpr float kLong = 2, kVeryLong = 4;
    /// Times what a task takes longer beside it: so much time to spare is enough to be held.
    static constexpr float kSpare = 2;

    /// Where it is noted that a launch of no chain was made, without a call of launched().
    /// @param launched  outlives it; set by any thread, cleared here
    void watch(std::atomic<bool>& launched) { launched_ = &launched; }
    /// A launch of no chain is made.
    void launched() {
        if (!launched_->load(std::memory_order_relaxed))
            launched_->store(true, std::memory_order_relaxed);
    }
    /// Due at every look at others: at the end of a window it is told whether they launched in it.
    /// @returns whether are_busy() has changed
    bool look(nanoseconds now);
    /// @returns how many windows have ended, if any: then saw() is due, by this caller
    int windows_ended(nanoseconds now);
    /// @param launched  whether a bystander did, in one of the windows
    /// @returns whether are_busy() has changed
    bool saw(bool launched, int windows = 1);
    /// An instance that shared the GPU with bystanders alone. Counts while they launch often.
    /// @param took, alone  the time that it took, and what it takes alone
    /// @param kernels      that it had
    void measured(nanoseconds took, nanoseconds alone, double kernels);

    bool are_busy() const { return busy_.load(std::memory_order_relaxed); }
    /// @returns whether a kernel that takes so long is to go, as one is busy
    bool are_busy(nanoseconds kernel) const { return are_busy() && !is_long(kernel, kLong); }
    /// @param remaining, laxity  of its task: GPU time alone, and what that leaves to the deadline
    /// @returns the same, also for a long one whose task has no time to spare (3)
    bool are_busy(nanoseconds kernel, nanoseconds remaining, nanoseconds laxity) const {
        return are_busy(kernel) ||
               (are_busy() && !is_long(kernel, kVeryLong) && !has_time(remaining, laxity));
    }
    /// @param kernels  that have not executed
    /// @returns by how much longer they take than alone; 0: no bystander is busy
    nanoseconds longer(double kernels) const;
    /// In about the last window, or since.
    bool are_there() const {
        return share_.load(std::memory_order_relaxed) >= kGain / 2 ||
               launched_->load(std::memory_order_relaxed);
    }

    /// What there was so far, for people.
    struct Counts {
        std::uint32_t windows = 0;  ///< of kWindow, with a look
        std::uint32_t often = 0;    ///< of those, in which bystanders launched often
        std::uint32_t busy = 0;     ///< of those, in which they were busy
    };
    Counts counts() const;

  private:
    bool is_known() const;
    bool matters() const;
    bool is_long(nanoseconds kernel, float times) const;
    bool has_time(nanoseconds remaining, nanoseconds laxity) const;

    std::atomic<bool> own_flag_{false};
    std::atomic<bool>* launched_ = &own_flag_;
    std::atomic<std::int64_t> next_ns_{0};
    std::atomic<float> share_{0};      ///< of windows, moving average
    std::atomic<float> slow_down_{0};  ///< moving average, while measured_ is not 0
    std::atomic<float> delay_ns_{0};   ///< of a kernel, likewise
    std::atomic<int> measured_{0};     ///< instances that have told these
    std::atomic<int> age_{0};          ///< windows since the last one
    std::atomic<bool> often_{false}, busy_{false};
    std::atomic<std::uint32_t> num_windows_{0}, num_often_{0}, num_busy_{0};
};

}  // namespace urgengo::sched
