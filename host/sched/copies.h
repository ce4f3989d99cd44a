// SPDX-License-Identifier: Apache-2.0
//
// Copies: how a large one is cut, how many slices of a task are under way, and whether a copy waits
// for those of more urgent tasks. Pure: no CUDA, no clock.
//
// A copy engine serves copies in order, whatever the priority of their streams: a copy of 64 KB
// behind one of 512 MB waits for 9.2 ms (H200, driver 580.159.04). So:
//
//  1 A large copy is cut into slices on its own stream, in order (cut_copy()).
//  2 No more than two slices of a thread are under way (CopyPace), so that the next copy waits for
//    two slices at most; the second one keeps the engine busy while the thread looks again.
//  3 Before a slice, or a whole copy, the thread waits while a more urgent task has copies at the
//    engine (copy_must_wait()): else every task that copies adds two slices to the wait of the most
//    urgent one.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "host/config/config.h"
#include "host/sched/snapshot.h"

namespace urgengo::sched {

/// Where one end of a copy lies, as the driver tells; an end that it does not know has `bytes` 0.
struct CopyEnd {
    std::uintptr_t begin = 0;       ///< of the copy
    std::uintptr_t allocation = 0;  ///< begin of what it must not leave
    std::size_t bytes = 0;          ///< of that
    bool on_host = false;
    bool is_managed = false;
    int device = -1;
};

/// How copies on the device are cut: they are that much faster.
inline constexpr std::size_t kOnDeviceFactor = 16;

/// @param slice_bytes  the config's; 0: nothing is cut
/// @returns the size of all slices but the last, which is no larger; 0: the copy goes as it came.
///          Slices are of nearly equal size: a small copy may be another thing to the driver.
std::size_t cut_copy(std::size_t bytes, std::size_t slice_bytes, const CopyEnd& to,
                     const CopyEnd& from);

/// Copies per time, taken for slow until something is known. Bytes per nanosecond are GB/s.
inline constexpr double kSlowGbps = 10;
inline constexpr nanoseconds kCopyLatency{20'000};

nanoseconds copy_time(std::size_t bytes, double gbps);

/// How long a copy that the engine has at hand is waited for at most, if it should take so long.
/// Beyond that its stream waits for something else, or the engine serves a bystander.
constexpr nanoseconds copy_bound(nanoseconds time) {
    return 2 * time + nanoseconds(2'000'000);
}

/// What one thread has under way, in at most two pieces that events are behind.
class CopyPace {
  public:
    static constexpr std::size_t kMaxUnderWay = 2;

    /// So much was copied. @returns whether it is time for an event behind it
    bool copied(std::size_t bytes, std::size_t slice_bytes);
    /// @returns the place of the next piece, for the caller's events
    std::size_t next() const { return (first_ + num_) % kMaxUnderWay; }
    /// The event of next() is behind all of it.
    /// @pre has_room()
    void marked(nanoseconds now);

    bool has_room() const { return num_ < kMaxUnderWay; }
    bool is_idle() const { return num_ == 0; }
    /// @pre !is_idle()
    std::size_t oldest() const { return first_; }
    /// The oldest was seen done. @returns how fast it was, GB/s, if that can be told: the engine
    ///          had it at hand when the one before it was done
    /// @param watched  it was seen not to be done a moment ago
    std::optional<double> finished(nanoseconds now, bool watched);
    /// The oldest should be done by now: its stream waits for something else.
    /// @pre !is_idle()
    bool is_overdue(nanoseconds now) const;
    /// How long to sleep before asking for the oldest again.
    nanoseconds sleep(nanoseconds now, double gbps, nanoseconds longest) const;
    std::size_t bytes_under_way() const;
    /// Forgets what is under way: its events are of no use any more.
    void forget() { *this = {}; }

  private:
    struct Piece {
        std::size_t bytes = 0;
        nanoseconds issued{0};
    };
    /// When the oldest began at the latest, if nothing else has the engine.
    nanoseconds begin_of_oldest() const;

    std::array<Piece, kMaxUnderWay> pieces_{};
    std::size_t first_ = 0, num_ = 0;
    std::size_t unmarked_ = 0;   ///< bytes since the last event
    nanoseconds last_end_{0};    ///< when the last one was seen done
    bool end_is_exact_ = false;  ///< and was watched until then
};

/// @param snapshot   the tasks whose order counts, first the one that wants to copy
/// @param unfinished shape [snapshot.tasks.size()]: which have copies at the engine
/// @returns whether one of those comes before it, in the policy's order
bool copy_must_wait(const config::Scheduler& scheduler, const Snapshot& snapshot,
                    std::span<const bool> unfinished);

}  // namespace urgengo::sched
