// SPDX-License-Identifier: Apache-2.0
//
// urgengo bench instances: runs the ten-chain workload without hints under UrgenGo, and compares
// the instances that were detected with the frames that the program had.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "tools/bench/smoke/bench_plan.h"

namespace urgengo::cli {

struct InstancesOptions {
    BenchOptions bench;
    std::string preset = "urgengo";
    std::size_t skip_first = 0;  ///< frames of each chain and run that do not count

    InstancesOptions() { bench.f_a = {0.9}; }
};

CLI::App* add_bench_instances(CLI::App& bench, InstancesOptions& options);

/// @param arguments  as the user wrote them, for the record
int cmd_bench_instances(InstancesOptions options, const std::vector<std::string>& arguments);

}  // namespace urgengo::cli
