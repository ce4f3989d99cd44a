// SPDX-License-Identifier: Apache-2.0
//
// What a task has launched last, launch by launch, so that any thread can tell from how much of it
// is done which kernel the GPU is at.
//
// Launches are numbered over the task's whole life (32 bits, wrapping), through instances and their
// overlaps; each entry says whose it is. The estimates line up on one axis, "work": launch n covers
// [end(n - 1), end(n)) of it, in nanoseconds of estimated GPU time. Marks are points on that axis.
//
// Written by the thread that runs the task (TaskState::busy), at every launch and mark: stores to
// one cache line. Read by any thread without a lock: a range read is good if the writer has not
// come round to it since, which still_holds() tells.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>

#include "urgengo/abi/shared_page.h"

namespace urgengo::model {

using std::chrono::nanoseconds;

struct LoggedLaunch {
    nanoseconds end{0};          ///< work up to and with this launch
    nanoseconds time{0};         ///< when the program launched it
    std::uint64_t kernel = 0;    ///< kernel_id(); 0: not known
    std::uint32_t position = 0;  ///< in its instance
    std::uint16_t instance = 0;  ///< low 16 bits, as in marks
};

class LaunchLog {
  public:
    /// A stream takes 1,020 launches, then the launching thread blocks (measured, H200): more are
    /// never in flight. Power of two.
    static constexpr std::uint32_t kLaunches = 1024;
    /// Entries that a reader may count on: the writer may be at the one after the newest.
    static constexpr std::uint32_t kReadable = kLaunches - 2;

    explicit LaunchLog(std::uint32_t first_launch = 0, std::uint32_t first_mark = 0)
        : count_(first_launch), last_mark_(first_mark) {
        marked({nanoseconds{0}}, first_mark);
    }

    /// Adds a launch. @threads the task's
    void launched(nanoseconds estimate, const LoggedLaunch& launch) {
        const std::uint32_t n = count_.load(kRelaxed);
        Entry& e = entries_[n % kLaunches];
        e.end_ns.store(end(n - 1).count() + estimate.count(), kRelease);
        e.time_ns.store(launch.time.count(), kRelease);
        e.kernel.store(launch.kernel, kRelease);
        e.place.store(std::uint64_t{launch.instance} << 32 | launch.position, kRelease);
        count_.store(n + 1, kRelease);
    }

    /// Adds a mark behind all launches so far, before it is launched itself.
    /// @param now  for GpuClock::Pair::launched
    /// @threads the task's
    void marked(nanoseconds now, std::uint32_t sequence) {
        Mark& m = marks_[sequence % abi::kMarkRing];
        m.launches.store(count_.load(kRelaxed), kRelease);
        m.time_ns.store(now.count(), kRelease);
        last_mark_.store(sequence, kRelease);
    }

    /// The same, and on which stream it is (0: not told), which stays until another one has its
    /// place.
    void marked(nanoseconds now, std::uint32_t sequence, std::uint64_t stream) {
        marks_[sequence % abi::kMarkRing].stream.store(stream, kRelaxed);
        marked(now, sequence);
    }

    std::uint32_t count() const { return count_.load(kAcquire); }
    std::uint32_t last_mark() const { return last_mark_.load(kAcquire); }
    /// @returns work up to and with launch n; before the first launch: 0
    nanoseconds end(std::uint32_t n) const {
        return nanoseconds(entries_[n % kLaunches].end_ns.load(kAcquire));
    }
    nanoseconds time(std::uint32_t n) const {
        return nanoseconds(entries_[n % kLaunches].time_ns.load(kAcquire));
    }
    LoggedLaunch at(std::uint32_t n) const {
        const std::uint64_t place = entries_[n % kLaunches].place.load(kAcquire);
        return {end(n), time(n), entries_[n % kLaunches].kernel.load(kAcquire),
                static_cast<std::uint32_t>(place), static_cast<std::uint16_t>(place >> 32)};
    }
    /// @returns how many launches came before the mark; of the last kMarkRing marks
    std::uint32_t launches_before_mark(std::uint32_t sequence) const {
        return marks_[sequence % abi::kMarkRing].launches.load(kAcquire);
    }
    nanoseconds mark_time(std::uint32_t sequence) const {
        return nanoseconds(marks_[sequence % abi::kMarkRing].time_ns.load(kAcquire));
    }
    std::uint64_t mark_stream(std::uint32_t sequence) const {
        return marks_[sequence % abi::kMarkRing].stream.load(kRelaxed);
    }
    /// @returns whether what was read of launch n and later ones, and of this mark and later ones,
    ///          was theirs
    bool still_holds(std::uint32_t n, std::uint32_t mark) const {
        return count_.load(kAcquire) - n < kLaunches &&
               last_mark_.load(kAcquire) - mark < abi::kMarkRing - 1;
    }

  private:
    static constexpr auto kRelaxed = std::memory_order_relaxed;
    static constexpr auto kAcquire = std::memory_order_acquire;
    static constexpr auto kRelease = std::memory_order_release;

    struct alignas(32) Entry {
        std::atomic<std::int64_t> end_ns{0};
        std::atomic<std::int64_t> time_ns{0};
        std::atomic<std::uint64_t> kernel{0};
        std::atomic<std::uint64_t> place{0xffff'ffff};  // behind it comes position 0
    };
    struct Mark {
        std::atomic<std::uint32_t> launches{0};
        std::atomic<std::int64_t> time_ns{0};
        std::atomic<std::uint64_t> stream{0};
    };

    std::array<Entry, kLaunches> entries_;
    std::array<Mark, abi::kMarkRing> marks_;
    alignas(64) std::atomic<std::uint32_t> count_;
    std::atomic<std::uint32_t> last_mark_;
};

}  // namespace urgengo::model
