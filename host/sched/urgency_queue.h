// SPDX-License-Identifier: Apache-2.0
//
// The urgency queue: the launches that wait, in the order in which they go.
//
// 1 The order is the policy's: the smallest key first, ties to the lower task index. A key is as of
//   the last decision about its launch; one that was let go without an order stands behind all.
// 2 There is no list: each launch publishes its key, and why it waits, in its task's slot. So
//   joining and leaving take no lock, and any thread reads the same order.
// 3 A launch that waits for its own run-ahead alone stands there, too, and does not count for the
//   others' places.
//
// A reader may see a launch that has just left, or one that has just joined with its last key: that
// costs one look.
//
// @source section 4.4 of the paper
// @threads a task's entry is written by the thread that has the task; any thread may read
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <span>

#include "host/sched/snapshot.h"
#include "urgengo/abi/shared_page.h"

namespace urgengo::sched {

struct QueuedLaunch {
    int task = -1;
    Why why = Why::kNone;
    int behind = -1;  ///< task: of those that it waits for, the first in order; -1: none
    nanoseconds since{0};
    Key key = 0;

    bool is_before(const QueuedLaunch& other) const {
        return key < other.key || (key == other.key && task < other.task);
    }
};

class UrgencyQueue {
  public:
    /// @param page  outlives it
    explicit UrgencyQueue(abi::SharedPage& page) : page_(page) {}

    /// The launch waits, or waits still: with what it was answered last. `since` counts where it
    /// does not stand here yet.
    void stands(const QueuedLaunch& launch);
    /// It goes, or is given up. Of a launch that does not stand here: nothing.
    void leaves(int task);

    /// A launch, or a copy, has slept up to now.
    void waited(nanoseconds now) { waited_at_.store(now, kRelaxed); }
    /// @returns when one has slept last
    nanoseconds waited_at() const { return waited_at_.load(kRelaxed); }

    /// @returns how many of those that wait for others go before a launch with this key
    int place(int task, Key key) const;
    /// @param[out] launches  those that wait, the first to go at its front; room for
    ///                       abi::kMaxTasks, else those of the lowest indices
    /// @returns how many they are
    std::size_t read(std::span<QueuedLaunch> launches) const;

  private:
    static constexpr auto kRelaxed = std::memory_order_relaxed;
    static QueuedLaunch read_entry(const abi::TaskSlot& slot, int task);
    template <typename Act>
    void for_each(Act&& act) const;

    abi::SharedPage& page_;
    std::atomic<nanoseconds> waited_at_{nanoseconds{0}};
};

}  // namespace urgengo::sched
