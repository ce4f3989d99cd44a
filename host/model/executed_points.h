// SPDX-License-Identifier: Apache-2.0
//
// When how much of a task's work had executed: what its last marks told, for who asks later
// (observe/executed_pieces.h).
//
// A point is written by the thread that saw the mark first, which may be any, and lies where the
// mark's number says. So two threads write two points, but in two cases:
//  - The mark's line is read again after the look, so the thread that saw mark m may find m + 1
//    there and write its point beside the thread that saw that one. Tag and work are the same, the
//    times some ns apart, and either is right.
//  - One that is kRing marks late may meet the writer of a newer one in its place. Then readers
//    find a tag that is not the fields', in the rare case for good: a point that makes no sense is
//    for them to leave out.
//
// @threads any; no lock, no call
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>

namespace urgengo::model {

using std::chrono::nanoseconds;

class ExecutedPoints {
  public:
    /// Marks of 100 ms, if the GPU has nothing else to do. Power of two.
    static constexpr std::uint32_t kRing = 1024;

    struct Point {
        nanoseconds time{0};  ///< on the host's clock
        nanoseconds work{0};  ///< executed then, on LaunchLog's axis
    };

    void add(std::uint32_t mark, const Point& point) {
        // Who reads one of the fields anew finds the tag gone. (No fences: the thread sanitizer
        // knows none.)
        Entry& entry = ring_[mark % kRing];
        entry.tag.store(kWritten, std::memory_order_relaxed);
        entry.time_ns.store(point.time.count(), std::memory_order_release);
        entry.work_ns.store(point.work.count(), std::memory_order_release);
        entry.tag.store(kIsPoint | mark, std::memory_order_release);
    }

    /// Calls act(const Point&) for each that is whole, in no order.
    template <typename Act>
    void for_each(Act&& act) const {
        for_each_of_last(0, kRing, act);
    }

    /// Calls act(const Point&) for each that is whole of the last marks, the oldest first; where
    /// these have none, older ones may be among them.
    /// @param newest  mark
    /// @param most    marks
    template <typename Act>
    void for_each_of_last(std::uint32_t newest, std::uint32_t most, Act&& act) const {
        for (std::uint32_t i = std::min(most, kRing); i-- > 0;) {
            const Entry& entry = ring_[(newest - i) % kRing];
            const std::uint64_t tag = entry.tag.load(std::memory_order_acquire);
            const Point point{nanoseconds(entry.time_ns.load(std::memory_order_acquire)),
                              nanoseconds(entry.work_ns.load(std::memory_order_acquire))};
            if ((tag & kIsPoint) != 0 && entry.tag.load(std::memory_order_relaxed) == tag)
                act(point);
        }
    }

  private:
    static constexpr std::uint64_t kIsPoint = std::uint64_t{1} << 32;
    static constexpr std::uint64_t kWritten = 0;  ///< or never was

    struct Entry {
        std::atomic<std::uint64_t> tag{kWritten};
        std::atomic<std::int64_t> time_ns{0}, work_ns{0};
    };

    std::array<Entry, kRing> ring_;
};

}  // namespace urgengo::model
