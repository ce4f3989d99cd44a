// SPDX-License-Identifier: Apache-2.0
//
// A nice value for threads of the program (`cpu: {nice: -15}`), and their own again. On a host
// whose cores are all busy a thread that has computed wakes up milliseconds late, and its frame
// with it: ten chains beside two endless loops a core missed 24 % of their deadlines, and 5 % under
// nice -15 (measured, 16 cores, docs/measurements.md).
//
// Only threads of the default policy, and only to go before others. Threads that such a thread
// makes begin with nice 0 (SCHED_RESET_ON_FORK): the program's helpers are not chains.
//
// Threads: any, each about itself; give_back() about all.
#pragma once

#include <sys/types.h>

#include <atomic>
#include <cstdint>
#include <mutex>
#include <optional>
#include <vector>

namespace urgengo {

class ThreadNice {
  public:
    /// What a thread knows of itself: when it last had it.
    using Seen = std::uint32_t;

    /// @param wanted  -20..-1; nothing: no thread is touched
    explicit ThreadNice(std::optional<int> wanted) : wanted_(wanted.value_or(0)) {
        if (!wanted) is_on_.store(false);
    }

    /// The calling thread has it from here on. Two loads if it has it already.
    void take(Seen& seen) {
        if (!is_on_.load(std::memory_order_relaxed) ||
            seen == round_.load(std::memory_order_relaxed))
            return;
        take_now(seen);
    }
    /// All threads have their own again, until they take it anew.
    void give_back();
    /// The calling thread ends: its number may be another thread's.
    void thread_ends();

  private:
    struct Holder {
        pid_t thread;
        int own;
    };

    void take_now(Seen& seen);

    const int wanted_;
    std::atomic<bool> is_on_{true};        // false for good once it is refused
    std::atomic<std::uint32_t> round_{1};  // counts give_back()
    std::mutex mutex_;
    std::vector<Holder> holders_;
};

}  // namespace urgengo
