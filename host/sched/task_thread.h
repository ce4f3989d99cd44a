// SPDX-License-Identifier: Apache-2.0
//
// The thread that has a task, as those see it that are held while its launch does not come.
//
// A thread that is late because it computes, gets no core or sleeps until a time is helped by
// nothing that a held launch could let go of. The system says so, and asking costs 6 us: what it
// said is believed for a moment.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>

#include "host/base/thread_wait.h"

namespace urgengo::sched {

using std::chrono::nanoseconds;

class TaskThread {
  public:
    /// @param thread  that begins an instance of the task (gettid); 0: not known
    /// @threads that one
    void has(int thread) {
        if (thread_.load(kRelaxed) != thread) {
            thread_.store(thread, kRelaxed);
            answer_.store(0, kRelaxed);
            in_a_row_.store(0, kRelaxed);
            waits_for_mutexes_.store(false, kRelaxed);
        } else if (const int n = in_a_row_.load(kRelaxed); n < kUsual) {
            in_a_row_.store(n + 1, kRelaxed);
        }
    }
    /// @returns whether it had the last instances: the next one may be expected of it, and not of
    ///          another thread of a pool
    bool is_usual() const { return in_a_row_.load(kRelaxed) >= kUsual; }
    /// @returns 0: not known
    int id() const { return thread_.load(kRelaxed); }
    /// @threads any
    ThreadWait wait(nanoseconds now) { return wait(now, kBelieved); }
    /// Where only a wait for a mutex counts: a thread that was never seen in one is asked seldom.
    ThreadWait wait_early(nanoseconds now) {
        return wait(now, waits_for_mutexes_.load(kRelaxed) ? kBelieved : kBelievedEarly);
    }

  private:
    static constexpr auto kRelaxed = std::memory_order_relaxed;
    static constexpr nanoseconds kBelieved{200'000}, kBelievedEarly{2'000'000};
    static constexpr std::int64_t kAnswers = 4;
    static constexpr int kUsual = 3;  ///< instances after its first one

    ThreadWait wait(nanoseconds now, nanoseconds believed);

    std::atomic<int> thread_{0};           ///< that had the task last
    std::atomic<std::int64_t> answer_{0};  ///< kAnswers x when it was asked (ns), + ThreadWait::For
    std::atomic<int> owner_{0};            ///< of the mutex
    std::atomic<int> in_a_row_{0};
    std::atomic<bool> waits_for_mutexes_{false};  ///< it was seen to
};

}  // namespace urgengo::sched
