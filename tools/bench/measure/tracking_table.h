// SPDX-License-Identifier: Apache-2.0
//
// What `urgengo bench tracking` found, as text and as JSON.
#pragma once

#include <string>

#include "tools/bench/measure/tracking_bench.h"

namespace urgengo::cli {

/// With a footer that says what is compared.
std::string format_tracking_table(const TrackingBench& bench);
std::string to_json(const TrackingBench& bench);

}  // namespace urgengo::cli
