// SPDX-License-Identifier: Apache-2.0
//
// Who was on the GPU at once, from a run's records.
//
//  1 A chain is on the GPU while a task of it has a GPU segment, less the task's holds: what is
//  held
//    was not launched yet, and what was launched before is mostly over by then.
//  2 A collision (tools/trace/collision.h) lasts as long as the chains are on the GPU so, and is of
//    as many chains as are in it.
#pragma once

#include <cstdint>
#include <vector>

#include "tools/trace/run_story.h"

namespace urgengo::report {

struct GpuSharing {
    bool is_known = false;  ///< GPU segments were recorded: not while UrgenGo only observes
    /// By how many chains were on the GPU at once: ns. [0] is the time in which none was.
    std::vector<std::int64_t> by_chains_ns;
    /// By how many chains collided at once: ns. [0] and [1] are always 0.
    std::vector<std::int64_t> collisions_ns;
    std::int64_t span_ns = 0;
    std::int64_t planned_ns = 0;  ///< what was launched takes alone, by the plans

    /// @returns 0..1: the part of the time in which a chain was on the GPU
    double busy_share() const;
    /// @returns 0..1: the part of the time in which chains collided
    double collision_share() const;
};

GpuSharing gpu_sharing(const trace::Run& run, const trace::RunStory& story);

}  // namespace urgengo::report
