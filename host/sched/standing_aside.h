// SPDX-License-Identifier: Apache-2.0
//
// Standing aside: where launching is what all wait for, scheduling only takes of it.
//
// 1 Launch-bound tasks that launch for so much of their periods that kCrowd or more do at a time,
//   in the mean, slow each other down, as they need one driver. Each look and each mark is then
//   launching that others do not get done, a hold frees nothing, and priorities decide little, as
//   the GPU waits for launches. (Seven traced networks at load 2.16, in turns in one process: 28.5
//   % missed, 35.2 when they do not stand aside, 29.1 without UrgenGo. They launch 2.3 to 5 at a
//   time there, and 1.2 to 1.4 at load 0.9. H200, 2026-11-28; docs/measurements.md, "Standing
//   aside".)
// 2 So the instances that begin then are observed only, as if the guard had chosen that, for 10 s
//   (kAside). After that all are scheduled for 0.3 s (kLooks looks), as only marks show how fast
//   tasks launch. If launching is still crowded at each look, they are let alone again. So 3 % of
//   the time are paid for knowing. (A launch then costs 115 to 168 ns more than with UrgenGo off,
//   1,400 to 1,500 more when they do not stand aside; the same runs.)
// 3 Not where the GPU has little room, or those that keep it busy need more than kMostGpuBound of
//   it: then it is worth deciding who gets it. Nor beside a busy bystander, whom only priorities
//   keep in its place, nor where tasks take turns at launching (model/launch_contention.h), or may
//   be found to have to: only those count that are known to launch in parallel.
// 4 Only for what packs by a plan: a config that asks for another policy, or for other admission,
//   gets it.
//
// @threads any
#pragma once

#include <atomic>

#include "host/config/config.h"
#include "host/sched/tasks.h"

namespace urgengo::sched {

class StandingAside {
  public:
    /// Tasks that launch at a time.
    static constexpr double kCrowd = 2;
    /// Of the GPU.
    static constexpr double kMostGpuBound = 0.5, kMostLoad = 0.95;
    static constexpr nanoseconds kEvery{100'000'000};  ///< from one look to the next
    static constexpr int kLooks = 3;
    static constexpr nanoseconds kAside{10'000'000'000};

    /// @param tasks  outlive it
    StandingAside(const config::Scheduler& scheduler, const Tasks& tasks);

    /// @returns whether it is time for look()
    bool is_due(nanoseconds now) {
        nanoseconds next = next_.load(std::memory_order_relaxed);
        return may_be_ && now >= next &&
               next_.compare_exchange_strong(next, now + kEvery, std::memory_order_relaxed);
    }
    void look(bool bystanders_are_busy, nanoseconds now);
    /// @returns whether an instance that begins now is observed only
    bool is_on() const { return is_on_.load(std::memory_order_relaxed); }

  private:
    bool is_crowded(nanoseconds now) const;

    const bool may_be_;
    const Tasks& tasks_;
    std::atomic<nanoseconds> next_{nanoseconds{0}};
    std::atomic<bool> is_on_{false};
    // Of the thread that looks; the next one does a kEvery later.
    std::atomic<int> crowded_{0};  ///< looks in a row
    std::atomic<nanoseconds> until_{nanoseconds{0}};
};

}  // namespace urgengo::sched
