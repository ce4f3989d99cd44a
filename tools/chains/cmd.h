// SPDX-License-Identifier: Apache-2.0
//
// The subcommands. Each adds itself to the command line, and sets `exit_code` when it has run.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace urgengo::chains {

inline constexpr int kExitFailure = 1;
inline constexpr int kExitInterrupted = 130;  ///< as a shell reports SIGINT

void add_calibrate(CLI::App& app);
/// @param command_line  as typed; goes into the report
void add_run(CLI::App& app, const std::string& command_line, int& exit_code);

}  // namespace urgengo::chains
