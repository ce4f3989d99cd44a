// SPDX-License-Identifier: Apache-2.0
//
// When each launch of a trace was on the GPU, by CUPTI's records (TraceTimes::kCupti).
//
//  1 A kernel's record is its launch's by the id of the call that launched it: of the driver's API,
//    or of the runtime's around it. A graph's launch has many, and is on the GPU from the first
//    one's begin to the last one's end; `parts` says when in between.
//  2 CUPTI's clock is turned into ours between pairs of both, linearly.
//  3 A launch is not known without a record (CUPTI dropped it, or the program was killed before it
//    came), or with one that CUPTI could not time (it then has no begin or no end). But of a graph
//    no launch of which ever had one, as it has no kernels, it is known that it takes no time.
//
// Times are on CLOCK_MONOTONIC.
#pragma once

#include <cstdint>
#include <vector>

#include "tools/trace/gpu_intervals.h"

namespace urgengo::trace {

/// CUPTI's clock in ours.
class CuptiClock {
  public:
    /// @param pairs  kClockPair records, in any order
    explicit CuptiClock(const std::vector<const TraceRecord*>& pairs);

    bool is_known() const { return !pairs_.empty(); }
    /// @returns CLOCK_MONOTONIC; before the first pair and behind the last one as between the two
    /// nearest
    std::int64_t to_monotonic(std::uint64_t cupti_ns) const;

  private:
    struct Pair {
        std::uint64_t cupti_ns;
        std::int64_t monotonic_ns;
    };
    std::vector<Pair> pairs_;
};

struct CuptiIntervals {
    std::vector<std::vector<GpuInterval>> launches;  ///< as gpu_intervals() returns them
    std::vector<GpuInterval> others;                 ///< kernels of no launch that was seen
};

CuptiIntervals cupti_intervals(const Trace& trace);

}  // namespace urgengo::trace
