// SPDX-License-Identifier: Apache-2.0
//
// urgengo discover: watches a program once, changes nothing, and writes a commented draft of its
// chains.yaml.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace urgengo::cli {

struct DiscoverOptions {
    std::string output = "chains.yaml";
    double seconds = 0;  ///< 0: until the program ends
    std::string trace;   ///< to read, instead of running the program
    bool keep_trace = false;
    bool force = false;
    std::string real_libcuda;
    bool json = false;
};

CLI::App* add_discover(CLI::App& app, DiscoverOptions& options);

/// @param program  the program and its arguments; may be empty with --trace
/// @returns an exit code: 0 if a draft was written
int cmd_discover(const DiscoverOptions& options, const std::vector<std::string>& program);

}  // namespace urgengo::cli
