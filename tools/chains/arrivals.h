// SPDX-License-Identifier: Apache-2.0
//
// When frames arrive and how long their CPU segments take, all decided before the run, so that two
// runs with the same seed and parameters differ in scheduling only. Pure.
#pragma once

#include <chrono>
#include <cstdint>
#include <vector>

#include "tools/chains/workload.h"

namespace urgengo::chains {

struct PlannedFrame {
    std::chrono::nanoseconds arrival{0};        ///< since the run's start
    std::vector<std::chrono::nanoseconds> cpu;  ///< CPU segment of each task
};

struct ArrivalSettings {
    std::uint32_t seed = 1;
    std::chrono::nanoseconds period{0};
    std::chrono::nanoseconds duration{0};
};

/// A random phase within the period, then one frame each period, late by a uniform 0..15 ms; CPU
/// segments within 10 % of their mean.
/// @param chain_index  gives each chain random numbers of its own
/// @returns the frames that arrive before `duration`, in order of arrival
std::vector<PlannedFrame> plan_frames(const Chain& chain, std::size_t chain_index,
                                      const ArrivalSettings& settings);

}  // namespace urgengo::chains
