// SPDX-License-Identifier: Apache-2.0
//
// A trace, taken apart once for everything that discover and check ask of it: segments, when each
// launch was on the GPU, and the NVTX ranges that each launch was in.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "tools/trace/gpu_intervals.h"
#include "tools/trace/segments.h"
#include "tools/trace/trace_reader.h"

namespace urgengo::discover {

/// The NVTX ranges open at each launch of a thread. Few stacks are different, so they are shared.
struct RangeStacks {
    std::vector<std::vector<std::uint64_t>> stacks;  ///< hashes, outermost first; [0] is empty
    std::vector<std::size_t> of_launch;              ///< index in `stacks`: shape [launch]

    const std::vector<std::uint64_t>& at(std::size_t launch) const {
        return stacks[of_launch[launch]];
    }
};

struct Observation {
    const trace::Trace& trace;
    std::vector<std::vector<trace::Segment>> segments;  ///< shape [thread][segment]
    std::vector<std::vector<trace::GpuInterval>> gpu;   ///< shape [thread][launch]
    std::vector<RangeStacks> ranges;                    ///< shape [thread]

    const trace::TraceRecord& launch(std::size_t thread, std::size_t index) const {
        return *gpu[thread][index].launch;
    }
    /// @returns the name of the thread when it made this launch
    std::string_view thread_name(std::size_t thread, std::size_t index) const;
    /// @returns GPU time of the launch; 0 if it is not known
    std::int64_t gpu_ns(std::size_t thread, std::size_t index) const;
    /// @returns GPU time of all launches that it is known of
    std::int64_t total_gpu_ns() const;
};

/// @param trace  outlives the observation
/// @param tasks  whose segments to find; of an empty config: none
Observation observe(const trace::Trace& trace, const trace::TaskMatcher& tasks);

}  // namespace urgengo::discover
