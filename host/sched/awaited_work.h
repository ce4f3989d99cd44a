// SPDX-License-Identifier: Apache-2.0
//
// Other tasks' work that a task's own work is behind: what the last few of its event waits were
// for.
//
// A deadline that is lent to the task later is lent to them, too (sched/lending.h). An entry is
// good for nothing once that work has executed, and says so itself: `until` only grows with what
// its task launches. So entries are never taken out, but overwritten by the next ones.
//
// @threads written by the thread that works on the task; should another one take the task over at
//          that moment, an entry may be lost. Any may read; a reader beside a writer may miss one.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>

#include "host/base/memory_orders.h"

namespace urgengo::sched {

using std::chrono::nanoseconds;

class AwaitedWork {
  public:
    static constexpr std::size_t kRemembered = 4;

    /// @param task   whose work it is
    /// @param until  GPU time that it had launched up to the event
    /// @param from   GPU time that the waiting task had launched: the rest is behind the wait
    void add(int task, nanoseconds until, nanoseconds from) {
        for (Entry& entry : entries_)
            if (entry.task.load(kRelaxed) == task && entry.from_ns.load(kRelaxed) == from.count()) {
                if (entry.until_ns.load(kRelaxed) < until.count())
                    entry.until_ns.store(until.count(), kRelaxed);
                return;
            }
        const std::size_t next = next_.load(kRelaxed);
        next_.store(next + 1, kRelaxed);
        Entry& entry = entries_[next % kRemembered];
        entry.task.store(-1, std::memory_order_release);
        entry.until_ns.store(until.count(), std::memory_order_release);
        entry.from_ns.store(from.count(), std::memory_order_release);
        entry.task.store(task, std::memory_order_release);
    }

    /// Calls act(task, until) for each wait that is before the end of this work of the task's own.
    /// `until` may be another wait's: it is to be held against what that task has launched.
    /// A wait with nothing launched behind it does not count: mostly it is for the next frame.
    /// @param own  GPU time that the task had launched by then
    template <typename Act>
    void for_each_before(nanoseconds own, Act&& act) const {
        for (const Entry& entry : entries_) {
            const int task = entry.task.load(std::memory_order_acquire);
            const nanoseconds until(entry.until_ns.load(std::memory_order_acquire));
            const nanoseconds from(entry.from_ns.load(std::memory_order_acquire));
            if (task >= 0 && entry.task.load(kRelaxed) == task && from < own) act(task, until);
        }
    }

  private:
    struct Entry {
        std::atomic<int> task{-1};
        std::atomic<std::int64_t> until_ns{0}, from_ns{0};
    };
    std::array<Entry, kRemembered> entries_;
    std::atomic<std::size_t> next_{0};
};

}  // namespace urgengo::sched
