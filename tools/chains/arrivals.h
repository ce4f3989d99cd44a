// SPDX-License-Identifier: Apache-2.0
//
// When frames arrive, how large they are and how long their CPU segments take, all decided before
// the run, so that two runs with the same seed and parameters differ in scheduling only. Pure.
#pragma once

#include <chrono>
#include <cstdint>
#include <vector>

#include "tools/chains/workload.h"

namespace urgengo::chains {

struct PlannedFrame {
    std::chrono::nanoseconds arrival{0};        ///< since the run's start
    std::vector<std::chrono::nanoseconds> cpu;  ///< CPU segment of each task
    std::vector<double> size;  ///< of each task's input, over the middle of its range
};

struct ArrivalSettings {
    std::uint32_t seed = 1;
    std::chrono::nanoseconds period{0};
    std::chrono::nanoseconds duration{0};
    bool variable = false;  ///< whether sizes vary; else they are 1
};

/// A random phase within the period, then one frame each period, late by a uniform 0..15 ms; CPU
/// segments within 10 % of their mean; inputs uniform in their range (the paper gives the range
/// only).
/// @param chain_index  its place in the workload: gives each chain random numbers of its own
/// @returns the frames that arrive before `duration`, in order of arrival
std::vector<PlannedFrame> plan_frames(const Chain& chain, std::size_t chain_index,
                                      const ArrivalSettings& settings);

}  // namespace urgengo::chains
