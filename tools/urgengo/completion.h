// SPDX-License-Identifier: Apache-2.0
//
// Scripts by which a shell completes the words of a command line.
#pragma once

#include <string>

#include "tools/urgengo/cli_tree.h"

namespace urgengo::cli {

std::string bash_completion(const CliCommand& root);
std::string zsh_completion(const CliCommand& root);
std::string fish_completion(const CliCommand& root);

}  // namespace urgengo::cli
