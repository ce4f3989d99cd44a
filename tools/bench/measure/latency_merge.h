// SPDX-License-Identifier: Apache-2.0
//
// Several results of `urgengo bench latency` as if of one long run. Pure.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "host/base/result.h"

namespace urgengo::cli {

/// Counts are added bin by bin and percentiles taken anew, by the rule of the library that counted
/// (interposer/own_time_histogram.h); means are of all values, maxima the largest.
/// @param texts  files of results, also merged ones; `files` are their names
/// @returns what is to be written: one entry of `runs` for each load, with its `seeds`
/// @errors the file, what was found and what is accepted: the same version, GPU and parameters but
///         for the seed, which each has its own
Result<nlohmann::ordered_json> merge_latencies(const std::vector<std::string>& texts,
                                               const std::vector<std::string>& files);

}  // namespace urgengo::cli
