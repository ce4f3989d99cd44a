// SPDX-License-Identifier: Apache-2.0
//
// How far apart marks are, in estimated GPU time: near enough that a look tells where a task is,
// far enough that a program hardly notices them.
//
// 1 Beside others: as the source has them (`progress: {every_us}`).
// 2 Alone, where no other task looks, twice that; after 0.1 s without others half of the run-ahead,
//   0.5 ms at most; in a lead half of that lead, 2 ms at most. A program that launches more slowly
//   than the GPU executes is hardly ever marked: at its run-ahead, 1 ms at most.
// 3 From kManyMarks under way on, more than a task has that is paced by the defaults on free cores,
//   they are farther apart, and twice as far after each kDoubleAfter more, so that the ring lasts
//   for longer (15 ms of short kernels).
// 4 Where launching is what all wait for, a mark takes of that, and no launch is held for lack of
//   room that could go by it. So those of a launch-bound task are 1 ms apart there. (Another one is
//   paced by them.) In the place of the others it looks who else launches
//   (model/launch_contention.h), as at a mark. (Seven launch-bound tasks at 1.4 times what they can
//   do missed 22.2 % with all marks, bare 19.1, and 19.2 so; simulated.)
//
// @threads any
#pragma once

#include "host/sched/lead.h"

namespace urgengo::sched {

class MarkSpacing {
  public:
    /// What takes so many times the run-ahead is marked at once in any case: if its thread waits
    /// for it in a way that is not seen, its end still is.
    static constexpr int kLongUnit = 5;
    /// Under way: as many as readers find in the ring, and one that has not got there yet.
    static constexpr std::uint32_t kMostMarks = abi::kMarkRing - 2;
    static constexpr std::uint32_t kManyMarks = 40, kDoubleAfter = 6;

    /// @param all of them  outlive it
    MarkSpacing(const config::Scheduler& scheduler, const Company& company, const Lead& lead)
        : scheduler_(scheduler), company_(company), lead_(lead) {}

    /// @param every  of the marks' source: config::mark_every()
    /// @returns from one mark of the task to the next, of estimates by the plan
    nanoseconds between(const GovernedTask& task, nanoseconds every, nanoseconds now) const;
    /// @returns whether a mark that is due is not worth its launch (4)
    /// @param is_scarce  Load::launching_is_scarce
    bool is_spared(const GovernedTask& task, bool is_scarce) const;
    /// @returns from where on a launch is long, of estimates by the plan
    nanoseconds long_unit(const GovernedTask& task) const {
        return task.planned(kLongUnit * scheduler_.run_ahead.limit);
    }

    static std::uint32_t under_way(const abi::TaskSlot& slot) {
        return slot.marks_issued.load(std::memory_order_relaxed) -
               slot.marks_done.load(std::memory_order_relaxed);
    }
    /// With one more the ring would forget what the oldest one under way vouches for.
    static bool ring_is_full(const abi::TaskSlot& slot) { return under_way(slot) >= kMostMarks; }

  private:
    const config::Scheduler& scheduler_;
    const Company& company_;
    const Lead& lead_;
};

}  // namespace urgengo::sched
