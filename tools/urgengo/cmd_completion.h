// SPDX-License-Identifier: Apache-2.0
//
// urgengo completion prints the script by which a shell completes command lines; urgengo man, which
// the build calls, writes the man pages.
#pragma once

#include <string>

#include "tools/urgengo/cli_tree.h"

namespace urgengo::cli {

struct CompletionOptions {
    std::string shell{};
};
CLI::App* add_completion(CLI::App& app, CompletionOptions& options);
/// @returns an exit code
int cmd_completion(const CompletionOptions& options, const CliCommand& root);

struct ManOptions {
    std::string folder{};
};
CLI::App* add_man(CLI::App& app, ManOptions& options);
/// Writes one page a command. @returns an exit code
int cmd_man(const ManOptions& options, const CliCommand& root);

}  // namespace urgengo::cli
