// SPDX-License-Identifier: Apache-2.0
//
// urgengo bench throughput: four equal chains without deadlines, bare and under UrgenGo, and how
// many instances they finish a second: the paper's throughput figure.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "tools/bench/measure/equal_chains.h"

namespace urgengo::cli {

struct BenchThroughputOptions {
    EqualChainsOptions runs;
    std::vector<double> f_a{1, 4};
    std::vector<std::string> rows{kBareRow, "vanilla", "urgengo"};
    int chains = 4;
};

CLI::App* add_bench_throughput(CLI::App& bench, BenchThroughputOptions& options);

/// @param arguments  of the command line, for the record
/// @returns an exit code
int cmd_bench_throughput(const BenchThroughputOptions& options,
                         const std::vector<std::string>& arguments);

}  // namespace urgengo::cli
