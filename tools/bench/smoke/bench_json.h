// SPDX-License-Identifier: Apache-2.0
//
// The raw record of a bench: conditions, and every run's own JSON, whole.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "tools/bench/smoke/bench_results.h"

namespace urgengo::cli {

std::string to_json(const BenchResults& results);

/// How the profiles were learned, and from how many instances of each task.
nlohmann::ordered_json profiles_json(const std::vector<ProfileSummary>& profiles);

}  // namespace urgengo::cli
