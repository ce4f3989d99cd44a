// SPDX-License-Identifier: Apache-2.0
//
// Runs a program once under UrgenGo, watched and otherwise left alone, and keeps its trace. Its
// input and output are ours.
#pragma once

#include <string>
#include <vector>

#include "host/config/config.h"
#include "tools/urgengo/program_setup.h"

namespace urgengo::cli {

struct TracedRun {
    int exit_code = 0;          ///< not 0: the program was not run, and
    std::string message;        ///< why
    int program_exit_code = 0;  ///< 128 + n if signal n ended it
    bool was_stopped = false;   ///< by us, when its time was over
};

/// Runs it in mode observe, with every kernel timed.
/// @param config   may be without chains
/// @param folder   for the resolved config; is there until the program ends
/// @param trace    the file to write
/// @param seconds  after this long it is asked to end (SIGINT, then SIGTERM, then SIGKILL, 5 s
///                 apart), with all that it started; 0: it ends by itself
/// @threads main only: signal handlers are the process'
TracedRun run_traced(const ProgramSetup& setup, const std::vector<std::string>& program,
                     const Environment& environment, config::Config config,
                     const std::string& folder, const std::string& trace, double seconds);

}  // namespace urgengo::cli
