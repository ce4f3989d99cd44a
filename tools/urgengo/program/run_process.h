// SPDX-License-Identifier: Apache-2.0
//
// Runs a child to its end, or for a time, keeps the end of what it printed (or lets it print), and
// takes Ctrl-C for both.
#pragma once

#include <chrono>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "tools/urgengo/environment.h"

namespace urgengo::cli {

struct ProcessResult {
    int exit_code = 0;         ///< 128 + n if signal n ended it
    bool interrupted = false;  ///< we got SIGINT or SIGTERM meanwhile, and passed it on
    bool timed_out = false;    ///< the limit was reached, and we sent it SIGINT
    std::string output;        ///< the last 64 KiB of its stdout and stderr
};

struct ProcessOptions {
    bool show_output = false;   ///< it prints to our stdout and stderr; ProcessResult::output stays
                                ///< empty
    bool keeps_stdout = false;  ///< with show_output: to our stderr alone
    std::chrono::milliseconds limit{0};  ///< it gets SIGINT after this long; 0: never
    std::chrono::seconds grace{2};       ///< from an interrupt or the limit to SIGKILL
};

/// The child dies with this process, and a grace after an interrupt at the latest.
/// @param arguments  the first is the program's path
/// @errors only if no child could be started
/// @threads main only: signal handlers are the process'
Result<ProcessResult> run_process(const std::vector<std::string>& arguments,
                                  const Environment& environment,
                                  const ProcessOptions& options = {});

/// The same for a child that must succeed.
/// @errors its exit code and the end of what it printed; an empty text if it was interrupted
Result<bool> run_to_end(const std::vector<std::string>& arguments, const Environment& environment);

/// @returns the text for a shell, quoted where need be
std::string shell_line(const std::vector<std::string>& arguments);

}  // namespace urgengo::cli
