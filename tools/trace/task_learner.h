// SPDX-License-Identifier: Apache-2.0
//
// From the instances of one task to its profile (profile_builder.h says how).
#pragma once

#include <vector>

#include "host/config/config.h"
#include "tools/trace/instances.h"
#include "tools/trace/kernel_times.h"

namespace urgengo::trace {

/// What the launches of a trace are looked up in. Everything outlives the view.
struct TraceView {
    const Trace& trace;
    const std::vector<std::vector<GpuInterval>>& intervals;
    const Contention& contention;
};

struct LearnedTask {
    config::TaskProfile profile;  ///< but for its name
    std::size_t samples = 0;
    std::size_t clean_samples = 0;
    std::size_t unmarked_launches = 0;
    std::size_t discarded_instances = 0;          ///< by CUPTI, with launches that have no record
    std::chrono::nanoseconds sum{0};              ///< the kernels' own times, overlap or not
    std::chrono::nanoseconds on_side_streams{0};  ///< and of those on branches but the first
    std::uint32_t streams = 0;                    ///< at most, in a segment
};

/// @param task  may have no instances
LearnedTask learn_task(const TraceView& view, const TaskInstances& task);

}  // namespace urgengo::trace
