// SPDX-License-Identifier: Apache-2.0
//
// Events of the program that were recorded behind work of a task: which task's, and how much of it.
// Known in the whole process, as events are.
//
// A fixed table; events that find no place are not known any more, the longest recorded first. Any
// thread, no lock, no allocation: an entry is written under a version (odd meanwhile), and a
// reader that finds it being written knows less.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <optional>

#include "host/progress/coverage.h"

namespace urgengo::progress {

using std::chrono::nanoseconds;

struct RecordedEvent {
    int task = -1;
    Coverage covered;         ///< which of the task's launches come before it
    nanoseconds gpu_time{0};  ///< estimated, of all launches that the task had made by then
};

class RecordedEvents {
  public:
    void recorded(const void* event, const RecordedEvent& record);
    /// It is gone, or was recorded behind what is of no task.
    void forget(const void* event);
    std::optional<RecordedEvent> find(const void* event) const;

  private:
    static constexpr std::size_t kSets = 256, kWays = 4;

    struct Entry {
        std::atomic<std::uint32_t> version{0};
        std::atomic<std::int32_t> task{-1};
        std::atomic<const void*> event{nullptr};
        std::atomic<std::uint64_t> serial{0};  ///< of the record: the larger, the later
        std::atomic<std::int64_t> gpu_time_ns{0};
        std::atomic<std::uint64_t> all{0};
        std::atomic<bool> is_forked{false};  ///< `on` says something
        std::array<std::atomic<std::uint64_t>, kMaxStreams> on{};
    };
    using Set = std::array<Entry, kWays>;

    static std::size_t set_of(const void* event) {
        return (reinterpret_cast<std::uint64_t>(event) * 0x9e3779b97f4a7c15u) >> 56;
    }
    static_assert(kSets == 256, "as many as the hash has values");
    /// @returns whether the entry is the caller's to write, and was about `event`
    static bool open(Entry& entry, const void* event);
    static void close(Entry& entry);

    std::array<Set, kSets> sets_{};
    std::atomic<std::uint64_t> next_serial_{1};
};

}  // namespace urgengo::progress
