// SPDX-License-Identifier: Apache-2.0
//
// How many hardware connections (CUDA_DEVICE_MAX_CONNECTIONS) a program gets: `env: {connections}`.
// More cost each process 0.6 s at its start (H200; six processes at a time 6 s), so `auto` asks for
// them only where more streams than the driver's eight may want to run at once, or where gates may
// be closed, each of which keeps a connection.
#pragma once

#include <algorithm>
#include <cstdlib>

#include "host/config/config.h"
#include "host/config/limits.h"
#include "host/config/task_count.h"

namespace urgengo::config {

/// Up to so many tasks, the driver's default of eight leaves a stream of ours and one of the
/// program's besides.
inline constexpr std::size_t kFewTasks = 6;
/// The driver's, unless the variable says another number.
inline constexpr int kDefaultConnections = 8;

/// @param variable  CUDA_DEVICE_MAX_CONNECTIONS; null: not set
/// @returns how many the driver makes, which reads the variable when it starts
inline int driver_connections(const char* variable) {
    const int most = static_cast<int>(kConnections.max);
    return variable ? std::clamp(std::atoi(variable), 1, most) : kDefaultConnections;
}

/// @returns the number to set where UrgenGo schedules; 0: leave what there is
inline int connections_of(const Config& config) {
    if (config.connections != kAutoConnections) return config.connections;
    const bool has_gates = config.scheduler.dispatch.where != Dispatch::kThread;
    return num_tasks(config.chains) > kFewTasks || has_gates ? static_cast<int>(kConnections.max)
                                                             : 0;
}

}  // namespace urgengo::config
