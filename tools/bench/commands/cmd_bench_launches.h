// SPDX-License-Identifier: Apache-2.0
//
// urgengo bench launches: the throughput of a chain of small kernels on this GPU, bare and under
// UrgenGo, and how long a launch keeps its thread.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace urgengo::cli {

struct BenchLaunchesOptions {
    double kernel_us = 3;
    std::vector<int> frame_launches{200, 5000};
    int chains = 10;
    int rounds = 3;
    double seconds = 2;
    unsigned iterations = 0;  ///< 0: found at the start
    std::string out;
};

CLI::App* add_bench_launches(CLI::App& bench, BenchLaunchesOptions& options);

/// @param arguments  as the user wrote them, for the record
/// @returns 0 if everything ran, whether or not the goal is met
int cmd_bench_launches(const BenchLaunchesOptions& options,
                       const std::vector<std::string>& arguments);

}  // namespace urgengo::cli
