// SPDX-License-Identifier: Apache-2.0
//
// Work of no chain that keeps the GPU busy. Nobody holds a bystander, so what chains are held and
// paced for is lost to it: beside a busy one nobody is held for lack of room, run-ahead is not
// bounded, nothing is learned of how long work takes, and priorities do what there is to do.
//
//  1 Launches of no chain are not counted one by one: the first one sets a flag, and whoever looks
//    at the GPU's tasks reads and clears it, once a window. A bystander is busy from kBusy of the
//    windows on, and until it is in less than kIdle of them.
//  2 A bystander that hardly slows anybody down does not count, however often it launches: an
//    instance that shared the GPU with nobody else tells (`measured_ns / expected_ns`). What is not
//    known, as chains are never alone, counts as slowed down.
//  3 A kernel that is longer than what a bystander puts between two launches of whoever is alone
//    with it is held as ever: an urgent chain of short kernels would have it in each of its gaps,
//    instead of the bystander's, and the GPU's priorities cannot help.
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
    /// Times what a bystander takes between two launches: from there on a kernel is long.
    static constexpr float kLong = 2;

    /// @returns whether a window has ended: then saw() is due, by this caller
    bool window_ended(nanoseconds now);
    /// @param launched  whether a bystander did, in the window
    /// @returns whether are_busy() has changed
    bool saw(bool launched);
    /// An instance that shared the GPU with bystanders alone.
    /// @param took, alone  the time that it took, and what it takes alone
    /// @param launches     that it made
    void measured(nanoseconds took, nanoseconds alone, std::uint32_t launches);

    bool are_busy() const { return busy_.load(std::memory_order_relaxed); }
    /// @returns whether a kernel that takes so long is to go, as one is busy
    bool are_busy(nanoseconds kernel) const {
        const float delay_ns = delay_ns_.load(std::memory_order_relaxed);
        return are_busy() &&
               !(delay_ns > 0 && static_cast<float>(kernel.count()) > kLong * delay_ns);
    }
    /// In about the last window.
    bool are_there() const { return share_.load(std::memory_order_relaxed) >= kGain / 2; }

  private:
    std::atomic<std::int64_t> next_ns_{0};
    std::atomic<float> share_{0};      ///< of windows, moving average
    std::atomic<float> slow_down_{0};  ///< moving average; 0: not known
    std::atomic<float> delay_ns_{0};   ///< of a launch, likewise
    std::atomic<bool> busy_{false};
};

}  // namespace urgengo::sched
