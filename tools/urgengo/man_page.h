// SPDX-License-Identifier: Apache-2.0
//
// A man page of a command, from what its --help tells.
#pragma once

#include <string>

#include "tools/urgengo/cli_tree.h"

namespace urgengo::cli {

/// @returns "urgengo-run.1"
std::string man_page_file(const CliCommand& command);
/// @param version  of the program
std::string man_page(const CliCommand& command, const std::string& version);

}  // namespace urgengo::cli
