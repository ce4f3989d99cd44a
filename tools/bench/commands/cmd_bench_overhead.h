// SPDX-License-Identifier: Apache-2.0
//
// urgengo bench overhead: what scheduling costs an instance with 1 to 40 chains, in UrgenGo's own
// decisions: the paper's figure on scheduling overhead. Needs the library that measures itself
// (interposer/own_time.h).
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "tools/bench/measure/equal_chains.h"

namespace urgengo::cli {

struct BenchOverheadOptions {
    EqualChainsOptions runs;
    std::vector<int> chains{1, 5, 10, 20, 30, 40};
    std::string preset = "urgengo";
    double f_a = 1;
};

CLI::App* add_bench_overhead(CLI::App& bench, BenchOverheadOptions& options);

/// @param arguments  of the command line, for the record
/// @returns an exit code
int cmd_bench_overhead(BenchOverheadOptions options, const std::vector<std::string>& arguments);

}  // namespace urgengo::cli
