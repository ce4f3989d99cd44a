// SPDX-License-Identifier: Apache-2.0
//
// urgengo run: starts a program with UrgenGo loaded into it.
//
//   1 validate chains.yaml and the profile, find out what `auto` stands for (priority_probe.h), and
//     write all of it resolved (resolve.h)
//   2 check that the loader will let us into the program (program_check.h)
//   3 set up its environment (environment.h), and become the program: its exit status is ours
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace urgengo::cli {

struct RunOptions {
    std::string config;  ///< empty: chains.yaml in the current folder
    std::string profile;
    bool allow_stale = false;
    std::string mode;
    bool observe = false;
    std::string preset;
    std::string stats;
    std::string trace;
    bool quiet = false;
    std::string real_libcuda;
    std::string interposer;  ///< empty: the one beside us
    bool no_probe = false;
    bool verbose = false;
};

/// Adds the options; main() cuts off "-- program args..." before they are parsed.
CLI::App* add_run(CLI::App& app, RunOptions& options);

/// @param program  the program and its arguments
/// @returns an exit code, only if the program was not started
int cmd_run(const RunOptions& options, const std::vector<std::string>& program);

}  // namespace urgengo::cli
