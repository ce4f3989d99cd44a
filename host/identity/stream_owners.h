// SPDX-License-Identifier: Apache-2.0
//
// Which task's work a stream carries, so that helper threads of a task are known by the stream
// that they launch on. A stream that has carried the work of two tasks tells nothing.
//
// Any thread, no lock. A table that is full, or a handle that collides, knows less, never wrong.
#pragma once

#include <cuda.h>

#include <array>
#include <atomic>
#include <cstdint>

#include "urgengo/abi/shared_page.h"

namespace urgengo::identity {

class StreamOwners {
  public:
    /// @param task  index of the task that launches on `stream`
    void used_by(CUstream stream, int task) {
        Entry& entry = at(stream);
        const std::uint64_t mine = pack(stream, task);
        const std::uint64_t found = entry.load(std::memory_order_relaxed);
        if (found == mine) [[likely]]
            return;
        if (found == 0)
            entry.store(mine, std::memory_order_relaxed);
        else if (same_stream(found, mine) && found != pack(stream, kShared))
            entry.store(pack(stream, kShared), std::memory_order_relaxed);
    }

    /// @returns the index of the only task that has used `stream`, or -1
    int owner(CUstream stream) const {
        const std::uint64_t found = at(stream).load(std::memory_order_relaxed);
        if (found == 0 || !same_stream(found, pack(stream, 0))) return -1;
        const int task = static_cast<int>(found & kShared);
        return task == kShared ? -1 : task;
    }

    void forget(CUstream stream) {
        Entry& entry = at(stream);
        if (same_stream(entry.load(std::memory_order_relaxed), pack(stream, 0)))
            entry.store(0, std::memory_order_relaxed);
    }

  private:
    using Entry = std::atomic<std::uint64_t>;
    static constexpr std::size_t kEntries = 1024;
    static constexpr int kTaskBits = 9, kShared = (1 << kTaskBits) - 1;
    static_assert(abi::kMaxTasks <= kShared);

    // User-space addresses have 48 bits, or 57 on a few machines whose loaders still stay below 48.
    static std::uint64_t pack(CUstream stream, int task) {
        return reinterpret_cast<std::uint64_t>(stream) << kTaskBits |
               static_cast<std::uint64_t>(task);
    }
    static bool same_stream(std::uint64_t a, std::uint64_t b) {
        return a >> kTaskBits == b >> kTaskBits;
    }
    Entry& at(CUstream stream) { return entries_[slot(stream)]; }
    const Entry& at(CUstream stream) const { return entries_[slot(stream)]; }
    static std::size_t slot(CUstream stream) {
        return (reinterpret_cast<std::uint64_t>(stream) * 0x9e3779b97f4a7c15u) >> 54;
    }

    std::array<Entry, kEntries> entries_{};
};

}  // namespace urgengo::identity
