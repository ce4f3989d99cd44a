// SPDX-License-Identifier: Apache-2.0
//
// How many threads mark kernels have.
//
//  1 A multiprocessor is configured for the shared memory of the kernels that it runs, by how many
//    of their blocks it could hold, and changes that only while it runs none. So a small kernel may
//    have to wait until another one ends, though there are threads and registers for it.
//  2 A mark of one thread begins within 10 us beside all kernels that were tried, but those whose
//    blocks have 512 threads or more and no shared memory: beside them it waits until a
//    multiprocessor is idle, which is until they end if they are on all of them. One of 256 threads
//    begins beside these, too.
//  3 But more threads find less room: a mark of 1024 waited for 0.8 ms beside a matrix product that
//    takes most registers, one of a single thread did not.
//  4 So marks have one thread, and 256 while kernels as in 2 are about that are long and on all
//    multiprocessors: for kKept after one was launched. Its stream a mark takes as long either way.
//
// (Measured, H100 and H200, 2026-11-26: docs/measurements.md, tools/bench/mark_room.py.) Shared
// memory that is not asked for at the launch is not known here.
//
// @threads any; takes no lock
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>

namespace urgengo::exec {

using std::chrono::nanoseconds;

class MarkWidth {
  public:
    static constexpr unsigned kWide = 256;
    static constexpr std::uint32_t kLeastThreads = 512;
    static constexpr nanoseconds kLong{500'000};
    static constexpr nanoseconds kKept{10'000'000'000};

    struct Kernel {
        std::uint64_t blocks = 1;
        std::uint32_t block_threads = 1, shared_bytes = 0;  ///< of a block
        nanoseconds time{0};                                ///< estimated
    };
    /// A chain launches a kernel. @param num_sms  multiprocessors of the GPU
    void launches(const Kernel& kernel, int num_sms, nanoseconds now) {
        if (kernel.block_threads < kLeastThreads) [[likely]]
            return;
        if (kernel.shared_bytes == 0 && kernel.time >= kLong && num_sms > 0 &&
            kernel.blocks >= static_cast<std::uint64_t>(num_sms))
            wide_until_ns_.store((now + kKept).count(), std::memory_order_relaxed);
    }
    /// @returns of a mark that is launched now
    unsigned threads(nanoseconds now) const {
        return now.count() < wide_until_ns_.load(std::memory_order_relaxed) ? kWide : 1;
    }

  private:
    std::atomic<std::int64_t> wide_until_ns_{0};
};

}  // namespace urgengo::exec
