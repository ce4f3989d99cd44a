// SPDX-License-Identifier: Apache-2.0
//
// urgengo compare: is a program better with UrgenGo? Its mode is switched to and fro while it runs,
// block by block, in random order within each pair of blocks; what differs is told with the
// interval that it is in (compare/paired_blocks.h). With --with-bare whole runs are the blocks.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>
#include <vector>

namespace urgengo::cli {

struct CompareOptions {
    std::string config, profile, preset, real_libcuda;  ///< as for `urgengo run`
    std::string with{"observe"};                        ///< off, observe, shadow, on
    std::string against{"on"};
    std::uint32_t pid = 0;  ///< 0: a program is started
    double block = 0;       ///< seconds; 0: five, or with --with-bare to its end
    int blocks = 40;
    double warm_up = 5;      ///< seconds
    std::uint64_t seed = 0;  ///< 0: one at random
    bool with_bare = false;
    bool json = false;
    bool quiet = false;
};

CLI::App* add_compare(CLI::App& app, CompareOptions& options);

/// @param program  the program and its arguments; empty with --pid
/// @returns an exit code
int cmd_compare(const CompareOptions& options, const std::vector<std::string>& program);

}  // namespace urgengo::cli
