// SPDX-License-Identifier: Apache-2.0
//
// urgengo ctl: looks at, and steers, processes that run under UrgenGo. It works while they hang: a
// thread of UrgenGo's waits there for nothing else.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace urgengo::cli {

struct CtlOptions {
    std::string what;       ///< off, observe, shadow, on, reload, status, dump
    std::string config{};   ///< of reload; empty: chains.yaml in the current folder
    std::string chain{};    ///< empty: all of them
    std::uint32_t pid = 0;  ///< 0: the one that there is
    bool all = false;
    bool json = false;
    bool quiet = false;
    double timeout = 2;  ///< seconds
    // Of dump (ctl_dump.h):
    std::string out{};
    bool on_miss = false;
    std::uint32_t in_a_row = 1;  ///< misses of a chain
    double after = 1;            ///< seconds, from the miss to the dump
    std::uint32_t files = 1;     ///< at most
};

CLI::App* add_ctl(CLI::App& app, CtlOptions& options);

/// @returns an exit code: 0 if every process has done, or will when it is continued, what was
/// asked.
///          Of all, one of another pid namespace need not answer
int cmd_ctl(const CtlOptions& options);

}  // namespace urgengo::cli
