// SPDX-License-Identifier: Apache-2.0
//
// urgengo top: chains by urgency, while the program runs, or hangs: nothing is asked of it.
// `--once` prints what there is now, for scripts as JSON.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "tools/urgengo/top/top_view.h"

namespace urgengo::cli {

struct TopCommand {
    std::uint32_t pid = 0;  ///< 0: all that this user may look at
    bool once = false;
    bool json = false;
    double interval = 0.5;  ///< seconds
    std::string sort{"urgency"};
    bool reverse = false;
    bool tasks = false;
    std::string filter{};
};

CLI::App* add_top(CLI::App& app, TopCommand& command);

/// @returns an exit code: 1 if there is no such process
int cmd_top(const TopCommand& command);

}  // namespace urgengo::cli
