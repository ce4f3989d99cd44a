// SPDX-License-Identifier: Apache-2.0
//
// Time as the scheduler sees it: CLOCK_MONOTONIC live, a counter in tests (tests/support).
#pragma once

#include <time.h>

#include <algorithm>
#include <chrono>
#include <cstdint>

namespace urgengo {

using std::chrono::nanoseconds;

inline nanoseconds monotonic_now() {
    timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return std::chrono::seconds(t.tv_sec) + nanoseconds(t.tv_nsec);
}

/// What a thread has had of the cores.
struct ThreadUse {
    nanoseconds cpu{0};       ///< for which it has run
    std::int64_t sleeps = 0;  ///< how often it has left its core by itself
};

/// Where the runtime gets the time from, and how it waits. Any thread may call all of it.
class Clock {
  public:
    virtual ~Clock() = default;
    virtual nanoseconds now() = 0;
    /// Returns after `duration`; never a cancellation point, leaves errno alone.
    virtual void sleep_for(nanoseconds duration) = 0;
    /// Of the calling thread. One system call: 0.35 us (2-core machine).
    virtual ThreadUse thread_use() { return {now()}; }
};

/// Between questions of a thread that waits: a 32nd of the wait so far, so that it gets longer by 3
/// % at most; but neither finer than pays nor coarser than hurts.
constexpr nanoseconds asking_interval(nanoseconds waited) {
    constexpr nanoseconds kFinest{20'000}, kCoarsest{100'000};
    return std::clamp(waited / 32, kFinest, kCoarsest);
}

/// The live clock. Sleeps with the raw system call: the C library's would be a new cancellation
/// point inside the program's CUDA calls.
class SteadyClock final : public Clock {
  public:
    nanoseconds now() override { return monotonic_now(); }
    void sleep_for(nanoseconds duration) override;
    ThreadUse thread_use() override;
};

/// Gives the calling thread a timer slack of 1 ns for as long as the object lives: with the default
/// of 50 us a 50 us sleep takes 120 us, with 1 ns it takes 79 us (measured, 2-core machine).
class FineTimerSlack {
  public:
    FineTimerSlack();
    ~FineTimerSlack();
    FineTimerSlack(const FineTimerSlack&) = delete;
    FineTimerSlack& operator=(const FineTimerSlack&) = delete;

  private:
    int previous_ns_;
};

}  // namespace urgengo
