// SPDX-License-Identifier: Apache-2.0
//
// Finds what a program does periodically on the GPU: its activities, each a sequence of frames.
//
//  1 A thread's segments usually repeat one unit (tools/trace/repeating_unit.h): one activity.
//  2 A thread may run several, as an executor's does. Then it sleeps before segments of different
//    types, at different rates. Its segments are cut before each type that it mostly sleeps before.
//    A segment's type is the NVTX range that it begins in, where all of a thread's are in few
//    ranges; else its first kernel and that one's size.
//  3 An activity may move between threads, as in a pool. Frames of one type on threads of one name
//    are put together where only that makes them regular.
//  4 Periodic is what has at least five frames, most of them about the median apart. Everything
//    else is left over. A loop without any pause is periodic too, and said to be one.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "tools/discover/observation.h"
#include "tools/discover/spread.h"
#include "tools/trace/instances.h"

namespace urgengo::discover {

inline constexpr std::size_t kMinFrames = 5;

struct Activity {
    std::vector<std::size_t> threads;     ///< indices in Trace::threads(), ascending
    std::vector<trace::Instance> frames;  ///< in time order, start-up left out
    std::uint64_t type = 0;               ///< equal for activities that begin alike
    bool is_alone = false;                ///< its threads run nothing else, but for starting up
    bool takes_turns = false;           ///< threads share the frames; else each of them has its own
    std::size_t start_up_launches = 0;  ///< on its threads, if it is alone on them
    Spread period_ns;                   ///< between the begins of its frames
    double idle_share = 0;  ///< of the time between frames, off the CPU and not waiting: median
};

/// Launches of no activity, and of which activity each launch is.
inline constexpr int kNoActivity = -1;
/// Before the first frame, or between frames, on a thread that runs several: of any of them.
inline constexpr int kAnyActivity = -2;

struct Activities {
    std::vector<Activity> list;            ///< by GPU time, most first
    std::vector<std::vector<int>> owners;  ///< index in `list`, or as above: shape [thread][launch]
};

Activities find_activities(const Observation& observation);

/// Puts the second activity into the first, for nothing tells them apart.
void merge(Activities& activities, std::size_t first, std::size_t second);

}  // namespace urgengo::discover
