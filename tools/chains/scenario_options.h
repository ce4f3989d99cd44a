// SPDX-License-Identifier: Apache-2.0
//
// Options of `run`: the workload file, and how hard it is pressed.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "tools/chains/scenario.h"
#include "tools/chains/workload.h"

namespace urgengo::chains {

struct ScenarioOptions {
    std::string workload_path = "workload.json";
    double f_a = 1.0, f_d = 1.0, f_tight = 0.4;
    std::vector<std::string> tight;  ///< overrides f_tight when given
    bool tight_given = false;
    std::string threads = "chain";
    std::vector<std::string> only;  ///< empty: all
    std::size_t copies = 0;         ///< 0: the chains themselves
    bool merge_tasks = false;
    bool no_deadlines = false;

    void add_to(CLI::App& command);

    /// The chains that are asked for, in the form that is.
    /// @throws std::runtime_error naming what the file or the options have wrong
    Workload load_workload() const;
    /// @throws std::runtime_error when --tight names a chain that the workload has not
    Scenario scenario(const Workload& workload) const;
    Threads thread_mode() const {
        return threads == "task" ? Threads::kPerTask : Threads::kPerChain;
    }
};

}  // namespace urgengo::chains
