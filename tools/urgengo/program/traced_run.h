// SPDX-License-Identifier: Apache-2.0
//
// Runs a program with UrgenGo loaded into it and a trace being written, for the commands that learn
// from watching: profile, discover, check.
#pragma once

#include <CLI/CLI.hpp>
#include <chrono>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "tools/urgengo/environment.h"
#include "tools/urgengo/program/program_setup.h"
#include "tools/urgengo/program/run_process.h"

namespace urgengo::cli {

/// Adds the options that all these commands have.
/// @param seconds, real_libcuda  hold the defaults; live as long as the command
void add_traced_run_options(CLI::App& command, double& seconds, std::string& real_libcuda);

struct TracedRun {
    std::string config;                  ///< absolute path of a resolved config
    std::string mode;                    ///< URGENGO_MODE
    std::string trace;                   ///< absolute path of the trace to be written
    std::string kernels = "marks";       ///< URGENGO_TRACE_KERNELS: how each is timed
    std::string cupti;                   ///< URGENGO_CUPTI
    int connections = 0;                 ///< as ScheduledProgram::connections
    bool keeps_stdout = false;           ///< what it prints goes to our stderr
    std::string what;                    ///< is done meanwhile: for a progress bar
    std::chrono::milliseconds limit{0};  ///< the program gets SIGINT after this long; 0: never
};

/// What ended the program.
struct TracedOutcome {
    int exit_code = 0;         ///< the program's own; 0 if we ended it
    std::string how;           ///< "it ended", "it was interrupted", ...: for one line of report
    bool ended_by_us = false;  ///< by Ctrl-C, or because its time was over
    bool interrupted = false;  ///< by Ctrl-C
};

/// The program's output is the user's to see, and on a terminal how long it has run. It has ten
/// seconds to end once it was asked to.
/// @errors one line: it could not be started, or wrote no trace and why that may be
Result<TracedOutcome> run_traced(const ProgramSetup& setup, const std::vector<std::string>& program,
                                 const Environment& environment, const TracedRun& run);

}  // namespace urgengo::cli
