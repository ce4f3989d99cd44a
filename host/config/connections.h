// SPDX-License-Identifier: Apache-2.0
//
// How many hardware connections (CUDA_DEVICE_MAX_CONNECTIONS) a program gets: `env: {connections}`.
// More cost each process 0.6 s at its start (H200; six processes at a time 6 s), so `auto` asks for
// them only where more streams than the driver's eight may want to run at once.
#pragma once

#include "host/config/config.h"
#include "host/config/limits.h"

namespace urgengo::config {

/// Up to so many tasks, the driver's default of eight leaves a stream of ours and one of the
/// program's besides.
inline constexpr std::size_t kFewTasks = 6;

/// @returns the number to set where UrgenGo schedules; 0: leave what there is
inline int connections_of(const Config& config) {
    if (config.connections != kAutoConnections) return config.connections;
    std::size_t num_tasks = 0;
    for (const Chain& chain : config.chains) num_tasks += chain.tasks.size();
    return num_tasks > kFewTasks ? static_cast<int>(kConnections.max) : 0;
}

}  // namespace urgengo::config
