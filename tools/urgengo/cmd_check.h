// SPDX-License-Identifier: Apache-2.0
//
// urgengo check: holds a chains.yaml against what the program does on the GPU, and says what
// matched, what matched twice, and what no rule explains.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace urgengo::cli {

struct CheckOptions {
    std::string config;  ///< empty: chains.yaml in the current folder
    double seconds = 0;  ///< 0: until the program ends
    std::string trace;   ///< to read, instead of running the program
    std::string stats;   ///< of a run under UrgenGo, to be told of
    std::string real_libcuda;
    bool json = false;
};

CLI::App* add_check(CLI::App& app, CheckOptions& options);

/// @param program  the program and its arguments; may be empty with --trace or --stats
/// @returns an exit code: 0 if every task of the config matched something, 1 if one did not
int cmd_check(const CheckOptions& options, const std::vector<std::string>& program);

}  // namespace urgengo::cli
