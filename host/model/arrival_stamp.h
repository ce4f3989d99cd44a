// SPDX-License-Identifier: Apache-2.0
//
// When a frame has arrived, as a program says it. Programs mix up their clocks: a simulation's time
// passed off as the wall clock is decades old. Such a stamp says nothing about the frame, so the
// time of the call takes its place; it is counted, and warned of at the end. Pure; any thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <limits>

namespace urgengo::model {

using std::chrono::nanoseconds;

/// Clocks of two machines, or a stamp that a queue delayed, differ by no more than this.
inline constexpr nanoseconds kStampGuard{1'000'000'000};

/// @returns the stamp, taken with the clock that shows `theirs` now, on the one that shows `ours`;
///          the nearest representable time if it is beyond all
constexpr nanoseconds convert_stamp(std::int64_t stamp_ns, nanoseconds theirs, nanoseconds ours) {
    std::int64_t age_ns = 0, time_ns = 0;
    constexpr std::int64_t kLeast = std::numeric_limits<std::int64_t>::min();
    constexpr std::int64_t kMost = std::numeric_limits<std::int64_t>::max();
    if (__builtin_sub_overflow(theirs.count(), stamp_ns, &age_ns))
        return nanoseconds(stamp_ns < 0 ? kLeast : kMost);
    if (__builtin_sub_overflow(ours.count(), age_ns, &time_ns))
        return nanoseconds(age_ns < 0 ? kMost : kLeast);
    return nanoseconds(time_ns);
}

/// @param period           of the chain
/// @param abandoned_after  a frame of this age has come to its end, or never will
/// @returns whether a frame that is told of at `now` may have arrived at `stamp`
constexpr bool is_plausible(nanoseconds stamp, nanoseconds now, nanoseconds period,
                            nanoseconds abandoned_after) {
    return stamp <= now + period + kStampGuard && stamp >= now - abandoned_after - kStampGuard;
}

}  // namespace urgengo::model
