// SPDX-License-Identifier: Apache-2.0
//
// Whether the host's cores are busy with other work, as far as it matters here: threads that sleep
// for their turn wake up late. By then the GPU has waited for them, so that launches better go
// ahead behind gates that the GPU opens (config: dispatch, where: auto), and threads of chains
// better go before others on the cores (config: cpu, nice), which a line at the program's end says.
//
//   1 What a sleep takes beyond what was asked for, and beyond kUsual_ns, is late.
//   2 In each window of kWindow in which there were kLeast sleeps: cores become busy when half of
//     the time was late, and are free again when less than a tenth was. Otherwise, and in windows
//     with fewer sleeps, they stay what they were.
//
// H100, 16 cores: none late; beside 32 busy loops 200 us of work between two sleeps of 50 us make
// nine of ten sleeps take milliseconds. There gates and a nice value help; beside 16 loops neither
// does, and gates are worse than threads (docs/measurements.md, gates): so half, not a tenth.
//
// @threads any; takes no lock. Windows are approximate: what two threads tell at once may count in
// either of two.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>

namespace urgengo::sched {

using std::chrono::nanoseconds;

class CoreLoad {
  public:
    static constexpr nanoseconds kWindow{250'000'000};
    static constexpr std::int64_t kUsual_ns = 200'000;
    static constexpr int kLeast = 20;

    /// @param took  of a sleep for `asked`, which has ended at `now`
    void slept(nanoseconds asked, nanoseconds took, nanoseconds now);
    bool are_busy() const { return are_busy_.load(std::memory_order_relaxed); }

    /// Windows in which there were enough sleeps, and those of them with busy cores.
    struct Counts {
        std::uint32_t windows = 0, busy = 0;
    };
    Counts counts() const {
        return {windows_.load(std::memory_order_relaxed), busy_.load(std::memory_order_relaxed)};
    }

  private:
    std::atomic<std::int64_t> begin_ns_{0}, took_ns_{0}, late_ns_{0};
    std::atomic<int> sleeps_{0};
    std::atomic<bool> are_busy_{false};
    std::atomic<std::uint32_t> windows_{0}, busy_{0};
};

}  // namespace urgengo::sched
