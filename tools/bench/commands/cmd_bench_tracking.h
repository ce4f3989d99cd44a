// SPDX-License-Identifier: Apache-2.0
//
// urgengo bench tracking: what knowing the executing kernel costs on this GPU, in GPU time and in
// CPU time a launch, for every way of tracking and source of progress.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "tools/bench/measure/tracking_bench.h"

namespace urgengo::cli {

CLI::App* add_bench_tracking(CLI::App& bench, BenchTrackingOptions& options);

/// @param arguments  as the user wrote them, for the record
/// @returns 0 if everything ran, whether or not the goal is met
int cmd_bench_tracking(const BenchTrackingOptions& options,
                       const std::vector<std::string>& arguments);

}  // namespace urgengo::cli
