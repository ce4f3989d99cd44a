// SPDX-License-Identifier: Apache-2.0
//
// urgengo bench calls: what UrgenGo adds to a driver call, in its thread. Runs the call benchmark
// bare and under UrgenGo, in turns, on a driver that does nothing (tools/bench/null_driver.cpp); no
// GPU is needed. (The simulated GPU's zero-cost mode passes every wait at once: no other chain
// could have work on the GPU there.)
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace urgengo::cli {

struct BenchCallsOptions {
    std::vector<int> chains{1, 10, 40};
    int rounds = 5;
    double min_seconds = 0.1;  ///< of each case
    std::string out;
};

CLI::App* add_bench_calls(CLI::App& bench, BenchCallsOptions& options);

/// @param arguments  as the user wrote them, for the record
/// @returns 0 if everything ran, whether or not the goals are met
int cmd_bench_calls(const BenchCallsOptions& options, const std::vector<std::string>& arguments);

}  // namespace urgengo::cli
