// SPDX-License-Identifier: Apache-2.0
//
// What `urgengo sim` tells of gates, of rows that closed some. Pure.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "tools/bench/smoke/bench_results.h"
#include "tools/sim/subject.h"

namespace urgengo::cli {

struct SimRun {
    RunResult result;
    std::optional<sim::GateCounts> gates;  ///< nothing: the row closes none
};

std::vector<RunResult> results_of(const std::vector<SimRun>& runs);

/// @param seconds  that frames arrived for in each run
/// @returns how many gates each row closed a second, as a table below an empty line;
///          empty: no row did
std::string format_gates(const std::vector<SimRun>& runs, double seconds);

/// Adds its gates to each run. @param json  runs in the same order
void add_gates(nlohmann::ordered_json& json, const std::vector<SimRun>& runs);

}  // namespace urgengo::cli
