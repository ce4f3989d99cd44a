// SPDX-License-Identifier: Apache-2.0
//
// A run in numbers, and the story of one of its frames in words.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "host/observe/miss_cause.h"
#include "tools/trace/run_story.h"

namespace urgengo::trace {

struct ChainSummary {
    std::string name;
    std::int64_t deadline_ns = 0;
    std::size_t frames = 0;  ///< that arrived
    std::size_t ended = 0, late = 0, exited = 0, dropped = 0;
    std::int64_t median_ns = 0, p99_ns = 0, max_ns = 0;  ///< latency
    std::size_t holds = 0;
    std::int64_t held_ns = 0, paced_ns = 0;
    std::vector<observe::CauseCount> causes;  ///< of the late ones, the most first
};

/// @returns one a chain, as the run has them
std::vector<ChainSummary> summarize(const Run& run, const RunStory& story);

/// Who opened gates, and when none was closed.
struct GateSummary {
    std::uint64_t host_rounds = 0, opened_by_host = 0;  ///< that opened gates, and how many gates
    std::uint64_t openings_by_gpu = 0;                  ///< as often, of a task some
    std::uint64_t gpu_rounds = 0;                       ///< while it did
    std::int64_t gpu_rounds_ns = 0;                     ///< that those took
    std::uint64_t parks = 0, refused = 0;  ///< refused: launches that waited in their threads
    std::int64_t parked_ns = 0, most_parked_ns = 0;
    std::int64_t most_opening_ns = 0;  ///< that opening all gates took

    bool has_any() const { return host_rounds > 0 || openings_by_gpu > 0 || parks > 0; }
};
GateSummary summarize_gates(const RunStory& story);
/// @returns one line: "rounds of the host opened 7 gates, ..."; empty if there were none
std::string gates_words(const GateSummary& gates);

/// @returns "3 x held behind camera": what most of its late frames were late for; empty if none was
std::string most_often(const ChainSummary& chain);

/// @returns the date at that time of CLOCK_MONOTONIC, in UTC; "?" if that is not known
std::string date_of(const Run& run, std::int64_t ns);

/// @returns indices of late frames, in the order of their ends
std::vector<std::size_t> late_frames(const RunStory& story);

/// @returns "late by 3.2 ms: held behind camera (2.9 ms)", "in time", ...
std::string outcome_words(const Run& run, const RunFrame& frame);

/// One line of a frame's story.
struct StoryLine {
    std::int64_t begin_ns = 0, end_ns = 0;  ///< from its arrival on; equal: a moment
    int depth = 0;                          ///< inside the one before
    std::string what;
};
/// @returns what was done for the frame, in the order of its times. Holds for the same reason that
///          follow each other are one line
std::vector<StoryLine> frame_story(const Run& run, const RunStory& story, std::size_t frame);

struct TimeOfChain {
    std::size_t chain = 0;
    std::int64_t time_ns = 0;
};
/// @returns behind whom its launches were held, and for how long, the longest first
std::vector<TimeOfChain> held_behind(const RunStory& story, std::size_t frame);
/// @returns for how long others had GPU segments during the frame's own, the longest first
std::vector<TimeOfChain> meanwhile(const RunStory& story, std::size_t frame);

}  // namespace urgengo::trace
