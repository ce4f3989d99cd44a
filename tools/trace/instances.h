// SPDX-License-Identifier: Apache-2.0
//
// The instances of a task: which of its segments belong to one frame. Known from hints and NVTX
// ranges, else learned (repeating_unit.h). Threads of one task are told apart and learn together.
//
// Start-up (building the model, tuning, warming up) is left out: what lies before the first
// instance, and instances at the begin that launch as many kernels as none of the later ones, or
// that follow each other twice as fast or four times as slowly.
#pragma once

#include <chrono>
#include <cstdint>
#include <string_view>
#include <vector>

#include "tools/trace/segments.h"

namespace urgengo::trace {

struct Instance {
    std::int64_t begin_ns = 0;  ///< its first launch
    std::size_t num_launches = 0;
    std::vector<Segment> segments;  ///< in time order; not empty
};

/// How the instances were told apart.
enum class Boundaries {
    kNone,       ///< they were not: every segment is taken for one
    kKnown,      ///< by hints or NVTX ranges
    kRepeating,  ///< by the unit that the segments repeat
    kBursts,     ///< by idle gaps
};

/// @returns "hints or ranges", "repeating segments", ...
std::string_view boundaries_name(Boundaries boundaries);

struct TaskInstances {
    Boundaries boundaries = Boundaries::kNone;
    std::vector<Instance> instances;  ///< in time order, start-up left out
    std::size_t num_launches = 0;     ///< of the task, all told
    std::size_t start_up_launches = 0;
    std::size_t irregular_launches = 0;  ///< later ones that are of no instance
    std::int64_t period_ns = 0;  ///< median time between begins; 0 if there are fewer than two
};

/// @param segments  one list for each thread that ran the task, in time order
/// @param period    as the chain has it; 0: not known
TaskInstances find_instances(const std::vector<std::vector<Segment>>& segments,
                             std::chrono::nanoseconds period);

/// @returns the lists with this task's segments only, without those that are empty then
std::vector<std::vector<Segment>> segments_of(const std::vector<std::vector<Segment>>& segments,
                                              int task);

}  // namespace urgengo::trace
