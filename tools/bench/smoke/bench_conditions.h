// SPDX-License-Identifier: Apache-2.0
//
// Whether two files of a bench's results were measured under the same conditions, so that they may
// be merged. Pure.
#pragma once

#include <nlohmann/json.hpp>
#include <set>
#include <string>

namespace urgengo::cli {

/// Everything that must be the same, by name; of the workload what its file says, wherever it came
/// from.
/// @param root  a file of results
/// @param free_parameters  that may differ
/// @throws nlohmann::json::exception if it is none
nlohmann::ordered_json conditions(const nlohmann::ordered_json& root,
                                  const std::set<std::string>& free_parameters);

/// @returns what differs between conditions, and what was found; empty if nothing does
std::string first_difference(const nlohmann::ordered_json& a, const nlohmann::ordered_json& b);

}  // namespace urgengo::cli
