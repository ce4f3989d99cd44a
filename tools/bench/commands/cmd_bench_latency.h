// SPDX-License-Identifier: Apache-2.0
//
// urgengo bench latency: what UrgenGo adds to every kind of call, and to every instance, over a
// long run of the ten-chain workload, to the last one in ten thousand. Needs the library that
// measures itself (interposer/own_time.h). Where no run may be so long, several are merged.
#pragma once

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "tools/bench/smoke/bench_plan.h"

namespace urgengo::cli {

struct BenchLatencyOptions {
    BenchOptions bench;
    std::string preset = "urgengo";
    std::vector<std::string> merge;  ///< results to merge instead of running anything
};

CLI::App* add_bench_latency(CLI::App& bench, BenchLatencyOptions& options);

/// @param own_time  what the measuring library wrote
/// @returns one line for each kind of call, and for what is known of instances
/// @errors what it lacks
Result<std::string> format_latencies(const nlohmann::ordered_json& own_time);

/// @param arguments  of the command line, for the record
/// @returns an exit code
int cmd_bench_latency(BenchLatencyOptions options, const std::vector<std::string>& arguments);

}  // namespace urgengo::cli
