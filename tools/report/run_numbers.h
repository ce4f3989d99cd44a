// SPDX-License-Identifier: Apache-2.0
//
// A run in the numbers that a report shows.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "tools/report/gpu_sharing.h"
#include "tools/report/miss_ratio.h"
#include "tools/trace/run_story.h"
#include "tools/trace/run_summary.h"

namespace urgengo::report {

struct ChainNumbers {
    trace::ChainSummary summary;
    MissRatio misses;                  ///< of the frames that are over
    std::vector<double> latencies_ms;  ///< of those that came to their end, sorted; not exited ones
    double percentile_ms(double share) const;  ///< 0 if there are none
};

/// Frames that were over within one bin of time.
struct TimeBin {
    double begin_s = 0;  ///< since the begin of the run
    std::size_t over = 0;
    /// Missed ones, by their causes.
    std::vector<std::pair<abi::MissCause, std::size_t>> missed;
    double cpu_cores = -1;  ///< used by the process; negative: not recorded
};

struct RunNumbers {
    double seconds = 0;
    std::vector<ChainNumbers> chains;  ///< as the run has them
    MissRatio misses;                  ///< of all frames
    double mean_miss_ratio = 0;        ///< the mean over the chains, as the paper counts
    double bin_s = 0;
    std::vector<TimeBin> bins;
    GpuSharing gpu;
    double cpu_cores = -1;  ///< the process' mean; negative: not recorded
    trace::GateSummary gates;
};

RunNumbers measure(const trace::Run& run, const trace::RunStory& story);

}  // namespace urgengo::report
