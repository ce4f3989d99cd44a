// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>

namespace urgengo::runtime {

/// For tests: every fourth launch or so waits up to 200 us, with other tasks or without.
class RandomHolds {
  public:
    /// @param seed  0: none
    explicit RandomHolds(std::uint64_t seed) : seed_(seed) {}

    bool are_on() const { return seed_ != 0; }
    /// @returns for how long the next launch waits; mostly 0. @threads any
    std::chrono::nanoseconds next() {
        constexpr std::uint64_t kLongest_us = 200;
        const std::uint64_t count = count_.fetch_add(1, std::memory_order_relaxed);
        std::uint64_t x = seed_ + count * 0x9e3779b97f4a7c15u;
        x = (x ^ (x >> 31)) * 0xbf58476d1ce4e5b9u;
        x ^= x >> 29;
        return std::chrono::microseconds(x % 4 == 0 ? (x >> 8) % kLongest_us : 0);
    }

  private:
    const std::uint64_t seed_;
    std::atomic<std::uint64_t> count_{0};
};

}  // namespace urgengo::runtime
