// SPDX-License-Identifier: Apache-2.0
//
// A run as tracks to be drawn, whatever draws them (run_perfetto.h, run_chrome.h). On one track no
// slice begins before the one before it has ended.
//
//   lidar
//     frames             one slice a frame, on as many tracks as are under way at once
//     detect             when the task works on a frame
//     detect: GPU        its GPU segments
//     detect: held       holds and pacing; an arrow comes from the work that it is held behind
//     detect: waits      for the GPU
//     detect: kernel, laxity, priority, held so far    counters: the first placed by the GPU's
//     clock
//   streams
//     stream 2           what marks vouch for of the launches on it (run_pieces.h); of what is on
//     it
//                        at once, on as many tracks
//   dispatcher
//     lidar/detect       launches behind gates
//     rounds             of the host, that opened gates
//     rounds of the GPU  that did, when a look of the host saw it
//     parks              no gate was closed, as calls waited for all GPU work
//   UrgenGo              what it does from when on
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "tools/trace/run_story.h"

namespace urgengo::trace {

using TrackArgument = std::pair<std::string, std::variant<std::int64_t, double, std::string>>;

struct TrackSlice {
    std::int64_t begin_ns = 0, end_ns = 0;
    std::string name;
    std::string category;
    std::vector<TrackArgument> arguments;
    std::vector<std::uint64_t> arrows_out;  ///< that begin here, by their numbers
    std::uint64_t arrow_in = 0;             ///< that ends here; 0: none does
};
struct TrackInstant {
    std::int64_t time_ns = 0;
    std::string name;
};
struct TrackValue {
    std::int64_t time_ns = 0;
    double value = 0;
};

struct Track {
    std::string name;
    int parent = -1;  ///< index; -1: the process
    enum class Kind { kGroup, kSlices, kCounter } kind = Kind::kSlices;
    std::string unit;  ///< of a counter
    std::vector<TrackSlice> slices;
    std::vector<TrackInstant> instants;
    std::vector<TrackValue> values;
};

/// @returns tracks; parents come before their children
std::vector<Track> timeline(const Run& run, const RunStory& story);

}  // namespace urgengo::trace
