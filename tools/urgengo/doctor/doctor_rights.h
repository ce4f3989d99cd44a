// SPDX-License-Identifier: Apache-2.0
//
// doctor: what this account may do with the processor's time.
#pragma once

#include <optional>

#include "tools/urgengo/doctor/doctor_report.h"

namespace urgengo::cli {

/// Real-time priority and nice values, tried in a child, and the timer slack.
/// @param nice  that the config asks for
Findings check_rights(std::optional<int> nice = std::nullopt);

/// @param status  text of /proc/<pid>/status
/// @returns whether its effective capabilities have this one
bool has_capability(const std::string& status, unsigned capability);

}  // namespace urgengo::cli
