// SPDX-License-Identifier: Apache-2.0
//
// Runs a child to its end, keeps the end of what it printed, and takes Ctrl-C for both.
#pragma once

#include <string>
#include <vector>

#include "host/base/result.h"
#include "tools/urgengo/environment.h"

namespace urgengo::cli {

struct ProcessResult {
    int exit_code = 0;         ///< 128 + n if signal n ended it
    bool interrupted = false;  ///< we got SIGINT or SIGTERM meanwhile, and passed it on
    std::string output;        ///< the last 64 KiB of its stdout and stderr
};

/// The child dies with this process, and two seconds after an interrupt at the latest.
/// @param arguments  the first is the program's path
/// @errors only if no child could be started
/// @threads main only: signal handlers are the process'
Result<ProcessResult> run_process(const std::vector<std::string>& arguments,
                                  const Environment& environment);

/// The same for a child that must succeed.
/// @errors its exit code and the end of what it printed; an empty text if it was interrupted
Result<bool> run_to_end(const std::vector<std::string>& arguments, const Environment& environment);

/// @returns the text for a shell, quoted where need be
std::string shell_line(const std::vector<std::string>& arguments);

}  // namespace urgengo::cli
