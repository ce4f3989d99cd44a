// SPDX-License-Identifier: Apache-2.0
//
// What benches of one program with a config of their own share: its environment, and reading what
// it wrote.
#pragma once

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <string>

#include "host/base/result.h"
#include "tools/urgengo/environment.h"

namespace urgengo::cli {

/// Under UrgenGo, with the driver that our own environment names.
/// @param config, mode, stats  empty: without
Environment environment_with(const std::string& interposer, const std::string& config,
                             const std::string& mode, const std::string& stats);

/// `--own-time-interposer`: the library that measures itself.
/// @param path  where the option's value goes; outlives the command
void add_own_time_option(CLI::App& command, std::string& path);
/// Completes that option: without a value, the library beside this program.
Result<bool> find_own_time_library(std::string& path);

/// @returns the kernel module's version; empty without one
std::string driver_version();

Result<nlohmann::ordered_json> read_json(const std::string& path);

/// Says what ended the runs. @param error  empty: interrupted
/// @returns the exit code
int end_of_runs(const std::string& error);

/// Writes a bench's results, and says where. @param path  empty: nowhere
/// @returns the exit code
int write_results(const std::string& path, const std::string& text);

}  // namespace urgengo::cli
