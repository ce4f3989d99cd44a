// SPDX-License-Identifier: Apache-2.0
//
// What `urgengo check`, `discover` and `profile` print with --json. Fields are only added:
// docs/configuration.md lists them. Pure.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "host/config/config.h"
#include "tools/discover/activities.h"
#include "tools/discover/claims.h"
#include "tools/discover/draft.h"
#include "tools/trace/profile_builder.h"

namespace urgengo::cli {

/// @param file  of the config
nlohmann::ordered_json claims_json(const std::string& file, const discover::Claims& claims);

/// @param file  of the draft
/// @param config  what the draft says
nlohmann::ordered_json draft_json(const std::string& file, const config::Config& config,
                                  const discover::Draft& draft,
                                  const discover::Activities& activities);

/// @param file  of the profile; empty: none was written
nlohmann::ordered_json profile_json(const std::string& file, const trace::LearnedProfile& learned);

/// Prints it on stdout; what is no UTF-8 is replaced.
void print_as_json(const nlohmann::ordered_json& json);

}  // namespace urgengo::cli
