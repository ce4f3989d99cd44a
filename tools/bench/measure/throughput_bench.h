// SPDX-License-Identifier: Apache-2.0
//
// What `urgengo bench throughput` found, and what it says of it. Pure.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/bench/smoke/bench_results.h"

namespace urgengo::cli {

/// Instances a second, of one arrival rate: shape [rows][rounds]; the rounds of all rows have the
/// same arrivals.
struct ThroughputLevel {
    double f_a = 1;
    std::vector<std::string> rows;
    std::vector<std::vector<double>> instances_per_s;

    Spread of(std::size_t row) const;
    /// Round by round. @param base  in `rows`, with instances in every round
    Spread ratio(std::size_t row, std::size_t base) const;
};

/// What the goal compares with: the row vanilla, else the first.
std::size_t base_row(const ThroughputLevel& level);

std::string format_throughput(const ThroughputLevel& level);
nlohmann::ordered_json throughput_json(const ThroughputLevel& level);

}  // namespace urgengo::cli
