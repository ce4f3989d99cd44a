// SPDX-License-Identifier: Apache-2.0
//
// How much is done for a chain, and how late a frame is: the two things that the guard
// (sched/guard.h) chooses and compares. Plain data.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>

namespace urgengo::sched {

using std::chrono::nanoseconds;

/// The more, the less is done.
enum class GuardMode : std::uint8_t {
    kEnforce,     ///< as the config says
    kPriorities,  ///< its launches go at the priority of its rank, and are neither held nor paced
    kObserve,     ///< its launches are counted
};

constexpr const char* to_word(GuardMode mode) {
    switch (mode) {
        case GuardMode::kEnforce:
            break;
        case GuardMode::kPriorities:
            return "priorities";
        case GuardMode::kObserve:
            return "observe";
    }
    return "enforce";
}

/// A frame that was ended early counts as one that took so many deadlines.
inline constexpr int kExitedDeadlines = 2;

constexpr double ratio_of(nanoseconds latency, nanoseconds deadline) {
    return static_cast<double>(latency.count()) /
           static_cast<double>(std::max(deadline, nanoseconds{1}).count());
}

/// What a frame counts for that took `ratio` of its deadline: 0 for one that is well in time, about
/// 1 for a late one. Between 0.9 and 1.1 it grows evenly: a frame that is barely in time tells as
/// much as one that is barely late. Not before: where much is scheduled many frames end just in
/// time, as they give way to others as long as they can. Beyond, little more: a frame that is given
/// up for the others must not outweigh those.
constexpr double lateness_of(double ratio) {
    constexpr double kFrom = 0.9, kTo = 1.1;
    const double grows = std::clamp((ratio - kFrom) / (kTo - kFrom), 0.0, 1.0);
    return grows + 0.1 * std::clamp(ratio - 1, 0.0, 3.0) + 0.02 * std::clamp(ratio, 0.0, 1.0);
}

}  // namespace urgengo::sched
