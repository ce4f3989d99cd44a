// SPDX-License-Identifier: Apache-2.0
//
// A config of two chains, with a period of 100 ms, where it does not matter what they do.
#pragma once

#include <chrono>
#include <utility>
#include <vector>

#include "host/config/config.h"

namespace urgengo::testing {

/// @param tasks  of each of the two
inline config::Config lidar_and_camera(std::chrono::nanoseconds lidar_deadline,
                                       std::chrono::nanoseconds camera_deadline,
                                       const std::vector<config::Task>& tasks) {
    config::Config config;
    for (const auto& [name, deadline] :
         {std::pair{"lidar", lidar_deadline}, std::pair{"camera", camera_deadline}}) {
        config::Chain chain;
        chain.name = name;
        chain.period = std::chrono::milliseconds(100);
        chain.deadline = deadline;
        chain.tasks = tasks;
        config.chains.push_back(chain);
    }
    return config;
}

}  // namespace urgengo::testing
