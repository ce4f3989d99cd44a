// SPDX-License-Identifier: Apache-2.0
//
// Watches a program under a config that may as well be without chains, and changes nothing of it.
#pragma once

#include <string>
#include <vector>

#include "host/config/config.h"
#include "tools/urgengo/program/traced_run.h"

namespace urgengo::cli {

/// @param config   in mode observe
/// @param folder   for the resolved config; is there until the program ends
/// @param trace    the file to write
/// @param seconds  after this long the program is interrupted; 0: never
/// @param keeps_stdout  what it prints goes to our stderr
/// @errors as run_traced(), or that the resolved config cannot be written
Result<TracedOutcome> trace_program(const ProgramSetup& setup,
                                    const std::vector<std::string>& program,
                                    const Environment& environment, const config::Config& config,
                                    const std::string& folder, const std::string& trace,
                                    double seconds, bool keeps_stdout);

}  // namespace urgengo::cli
