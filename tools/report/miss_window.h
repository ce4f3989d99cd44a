// SPDX-License-Identifier: Apache-2.0
//
// What all chains did around one frame, as bars to be drawn: a row a task, the frame's own first.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/trace/run_story.h"

namespace urgengo::report {

enum class BarKind { kWork, kGpu, kHeld, kPaced, kGate, kWait };

/// @returns "on the GPU", "held", ...
const char* in_words(BarKind kind);
inline constexpr BarKind kBarKinds[] = {BarKind::kWork,  BarKind::kGpu,  BarKind::kHeld,
                                        BarKind::kPaced, BarKind::kGate, BarKind::kWait};

struct Bar {
    BarKind kind = BarKind::kWork;
    std::size_t row = 0;
    double begin_ms = 0, end_ms = 0;  ///< since the frame's arrival
    std::string words;
};

struct MissWindow {
    double begin_ms = 0, end_ms = 0;  ///< since the frame's arrival
    double deadline_ms = 0, ended_ms = 0;
    std::vector<std::string> rows;  ///< tasks that did something in it
    std::vector<Bar> bars;
};

/// Around the frame: a third of its deadline before its arrival, a tenth behind its end.
/// @param frame  its index in the story
MissWindow miss_window(const trace::Run& run, const trace::RunStory& story, std::size_t frame);

/// Which late frames to show, if there are more than can be: of each chain in turn those with the
/// longest latency.
/// @returns indices of frames, by their arrivals
std::vector<std::size_t> choose_misses(const trace::Run& run, const trace::RunStory& story,
                                       std::size_t most);

}  // namespace urgengo::report
