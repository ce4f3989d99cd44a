// SPDX-License-Identifier: Apache-2.0
//
// LentForks: whether a task over several streams may launch its forks at once.
//
// A fork is paced (host/model/fork_progress.h) by holds in its thread. That thread may have a lock
// for which others wait, up to the fork's last launch. That others were awaited while a fork was
// held, so that it was lent their urgency, may be chance once. Three times in four instances it is
// taken for a lock, and the task's forks are not paced for ten seconds. (Paced all the same, a task
// that held a lock over forks of 36 ms made another miss 3 of 20 frames, bare 0; free at the first
// loan, hardly any fork was paced. `sweep.py --first 3`, `--first 600`, simulated GPU.)
//
// Pure; the task's owner only.
#pragma once

#include <algorithm>
#include <bit>
#include <chrono>
#include <cstdint>

namespace urgengo::sched {

using std::chrono::nanoseconds;

class LentForks {
  public:
    /// A launch within a fork was lent others' urgency.
    void lent(std::uint32_t instance, nanoseconds now) {
        if (instance != last_) {
            const unsigned since = std::min(kInstances, instance - last_);
            instances_ = ((instances_ << since) | 1) & ((1U << kInstances) - 1);
            last_ = instance;
        }
        if (std::popcount(instances_) >= kOften) free_until_ = now + kFree;
    }
    /// @returns whether forks are not to be paced
    bool are_free(nanoseconds now) const { return now < free_until_; }

  private:
    static constexpr unsigned kInstances = 4;
    static constexpr int kOften = 3;
    static constexpr nanoseconds kFree{10'000'000'000};

    std::uint32_t last_ = 0;
    unsigned instances_ = 0;  ///< with a loan: a bit each, the last one first
    nanoseconds free_until_{0};
};

}  // namespace urgengo::sched
