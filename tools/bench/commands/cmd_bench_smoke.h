// SPDX-License-Identifier: Apache-2.0
//
// urgengo bench smoke: the ten-chain workload at a few loads, bare and under presets, on the same
// arrivals; on the GPU if there is one, else on the simulated GPU, and it says which.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "tools/bench/smoke/bench_plan.h"

namespace urgengo::cli {

CLI::App* add_bench_smoke(CLI::App& bench, BenchOptions& options);

/// @param arguments  as the user wrote them, for the record
int cmd_bench_smoke(const BenchOptions& options, const std::vector<std::string>& arguments);

}  // namespace urgengo::cli
