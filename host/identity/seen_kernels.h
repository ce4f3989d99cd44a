// SPDX-License-Identifier: Apache-2.0
//
// Which kernels the process has launched before. Asked where a thread meets a kernel that it does
// not know, so not at most launches; yet without a lock: a kernel whose place another one takes
// counts as new again, which does no harm (implicit_sync.cpp).
#pragma once

#include <array>
#include <atomic>
#include <cstdint>

namespace urgengo::identity {

class SeenKernels {
  public:
    /// Remembers the kernel. Any thread.
    /// @returns whether it was not remembered
    bool is_new(const void* function) {
        const std::uint64_t mixed =
            reinterpret_cast<std::uint64_t>(function) * std::uint64_t{0x9e3779b97f4a7c15};
        // Not the bits that threads choose a place by: two kernels that make each other forgotten
        // there do not do so here, too.
        auto& place = places_[(mixed >> 32) % kPlaces];
        const std::uint64_t key = mixed ^ epoch_.load(std::memory_order_relaxed);
        return place.exchange(key, std::memory_order_relaxed) != key;
    }

    /// Handles may come to mean other kernels.
    void forget() { epoch_.fetch_add(1, std::memory_order_relaxed); }

  private:
    static constexpr std::size_t kPlaces = 4096;
    std::array<std::atomic<std::uint64_t>, kPlaces> places_{};
    std::atomic<std::uint64_t> epoch_{1};
};

}  // namespace urgengo::identity
