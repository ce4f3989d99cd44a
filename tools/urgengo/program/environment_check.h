// SPDX-License-Identifier: Apache-2.0
//
// Says before a program starts what UrgenGo would only find out inside it, or when all is over:
// variables with values that are not accepted, misspelt ones, files that cannot be written.
#pragma once

#include <string>
#include <vector>

#include "tools/urgengo/environment.h"

namespace urgengo::cli {

struct EnvironmentCheck {
    std::string error;  ///< one line: variable, found, accepted; empty: none
    std::vector<std::string> warnings;
};

/// @param environment  as the program is to get it
EnvironmentCheck check_environment(const Environment& environment);

/// @returns why no file can be made there: one line; empty if one can
std::string why_not_writable(const std::string& path);

}  // namespace urgengo::cli
