// SPDX-License-Identifier: Apache-2.0
//
// What `run --stamps` writes: a line of JSON that says what follows, then that, as plain arrays in
// the host's byte order (tools/bench/stamps_file.py reads it). Pure.
//
// The line's `arrays` lists each array: name, how many elements, of how many bytes, its fields as
// Python's struct writes them. They follow each other without gaps: for each of `streams` its
// stamps and its runs, then all samples.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/chains/position_sampler.h"
#include "tools/chains/stream_results.h"
#include "tools/chains/task_runs.h"

namespace urgengo::chains {

inline constexpr int kStampsFormatVersion = 1;

/// At gpu_ns on the GPU it was host_ns on the host, give or take bound_ns.
struct ClockReading {
    std::int64_t host_ns = 0;   ///< CLOCK_MONOTONIC
    std::int64_t gpu_ns = 0;    ///< %globaltimer
    std::int64_t bound_ns = 0;  ///< half of the shortest round trip
    int round_trips = 0;        ///< 0: the simulated GPU's, known
};

/// What a thread's stream was used for.
struct StampedStream {
    std::string chain;
    std::vector<std::string> tasks;  ///< of the chain, all
    std::uint32_t launches = 0;      ///< made; more than stamps: some left none
    std::vector<LaunchStamp> stamps;
    std::vector<TaskRun> runs;
};

struct StampsFile {
    std::string gpu, urgengo, command_line;
    std::vector<ClockReading> clock;  ///< before the run and after it
    std::vector<StampedStream> streams;
    double sample_mean_us = 0;
    std::uint32_t sample_seed = 0;
    PositionSampler::Summary sampler;
    std::vector<PositionSample> samples;  ///< target: which of the streams
};

std::string format_stamps(const StampsFile& file);

/// @returns one line for people: how much there is, what is missing, what sampling cost
std::string describe_stamps(const StampsFile& file);

}  // namespace urgengo::chains
