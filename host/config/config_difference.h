// SPDX-License-Identifier: Apache-2.0
//
// What is other in a config than in the one that a program was started with: what can change while
// it runs, and what cannot. Pure.
#pragma once

#include <string>
#include <vector>

#include "host/config/config.h"

namespace urgengo::config {

struct ConfigDifference {
    std::vector<std::string> changed;  ///< "chain 'lidar': deadline_ms 80 -> 60"
    std::vector<std::string> refused;  ///< the same, of what only a new start changes
};

/// Can change: the mode, and of each chain its period, deadline, on_late, criticality,
/// max_consecutive_misses, and its mode unless that is, or becomes, off. A `priority_via` that is
/// not resolved in `next` is no difference.
ConfigDifference difference(const Config& now, const Config& next);

/// @returns "a; b; c"
std::string joined(const std::vector<std::string>& parts);

}  // namespace urgengo::config
