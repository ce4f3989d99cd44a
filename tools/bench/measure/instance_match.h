// SPDX-License-Identifier: Apache-2.0
//
// Compares the instances that UrgenGo took a chain's frames for with the frames that there were.
// Pure. All times are on CLOCK_MONOTONIC.
//
//   frame      |arrival   [begin (first launch called)] [first_launched (it returned)] ... end|
//   instance                 [begin ...                                               ... end)
//
// A detected begin within a frame's first launch is that frame's begin, however long the thread was
// held or preempted in it; kMatchTolerance allows for the two programs' clock readings. Then:
//
//   false start   a detected begin that is no frame's: within a frame, or a second one of a frame
//   missed start  a frame that no detected instance begins with
//   merged        a detected instance that covers several frames (all but the first of them are
//                 missed starts, too)
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

namespace urgengo::cli {

inline constexpr std::chrono::microseconds kMatchTolerance{50};

/// A frame that ran from its first launch to its end.
struct TrueFrame {
    std::chrono::nanoseconds arrival{0}, begin{0}, first_launched{0}, end{0};
};

struct DetectedInstance {
    std::chrono::nanoseconds arrival{0}, begin{0};
    std::optional<std::chrono::nanoseconds> end;  ///< none: lasts until the next begin
    bool observed = false;  ///< its task was only observed, for want of confidence
    bool resync = false;    ///< ended by a count that did not fit
};

/// Of one chain, or summed over several.
struct InstanceMatch {
    std::uint64_t frames = 0, detected = 0;
    std::uint64_t false_starts = 0, missed_starts = 0, merged = 0;
    std::uint64_t observed = 0, resyncs = 0;  ///< of `detected`
    /// Detected less true, of instances that begin with a frame and cover no other.
    std::vector<double> begin_error_us, end_error_us, arrival_error_us;

    InstanceMatch& operator+=(const InstanceMatch& other);
};

/// @param frames      of one chain; one at a time, so none begins before another's end
/// @param detected    of the same chain
/// @param skip_first  so many of the first frames do not count, nor does what begins before the
///                    next one
InstanceMatch match_instances(std::vector<TrueFrame> frames, std::vector<DetectedInstance> detected,
                              std::size_t skip_first = 0);

}  // namespace urgengo::cli
