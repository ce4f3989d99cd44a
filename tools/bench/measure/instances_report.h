// SPDX-License-Identifier: Apache-2.0
//
// What `urgengo bench instances` found, as a table and as JSON. Pure.
#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "tools/bench/measure/instance_match.h"

namespace urgengo::cli {

/// All runs at one load.
struct InstancesLevel {
    double f_a = 0;
    std::vector<double> miss_pct;                 ///< overall deadline miss ratio of each run
    std::map<std::string, InstanceMatch> chains;  ///< by name, summed over the runs

    InstanceMatch overall() const;
};

struct ErrorSummary {
    double median_us = 0;   ///< signed: detected less true
    double p95_abs_us = 0;  ///< nearest rank, as is the maximum of the magnitude
    double max_abs_us = 0;
};

/// @param errors_us  none: all 0
ErrorSummary summarize_errors(const std::vector<double>& errors_us);

std::string format_instances(const InstancesLevel& level);

/// Counts, and each as a share: of the true instances; `observed` and `resyncs` of the detected.
nlohmann::ordered_json instances_json(const InstancesLevel& level);

}  // namespace urgengo::cli
