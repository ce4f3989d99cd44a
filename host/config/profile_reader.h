// SPDX-License-Identifier: Apache-2.0
//
// Reads a profile (profile_json.h has the format) and compares it with a config. For tools.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "host/base/result.h"
#include "host/config/config.h"

namespace urgengo::config {

/// @errors one line: file, JSON path (line and column for a syntax error), found, accepted
Result<Profile> read_profile(const std::string& path);

/// The same for a text that was read already; `file` is what errors call it.
Result<Profile> parse_profile(std::string_view text, const std::string& file);

/// @returns one line for each chain or task that only one of the two knows; such a task is
/// scheduled
///          with estimates made while it runs
std::vector<std::string> profile_warnings(const Config& config, const Profile& profile);

}  // namespace urgengo::config
