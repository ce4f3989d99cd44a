// SPDX-License-Identifier: Apache-2.0
//
// A program that we have started and look at while it runs.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "tools/urgengo/environment.h"

namespace urgengo::cli {

class StartedProgram {
  public:
    /// It dies with this process, and prints to our stderr if `keeps_stdout`.
    /// @param arguments  the first is the program's path
    static Result<StartedProgram> start(std::vector<std::string> arguments,
                                        const Environment& environment, bool keeps_stdout);
    StartedProgram(StartedProgram&& other) noexcept;
    StartedProgram& operator=(StartedProgram&&) = delete;
    /// Ends it.
    ~StartedProgram();

    pid_t process() const { return process_; }
    /// @returns its exit code, 128 + n if signal n ended it; nothing while it runs
    std::optional<int> exit_code();
    /// Asks it to end (SIGINT, unless it has been asked by Ctrl-C), and ends it after ten seconds.
    int end();
    /// CPU time of it and of its children that it has waited for; once it has ended.
    double cpu_s() const { return cpu_s_; }

  private:
    explicit StartedProgram(pid_t process) : process_(process) {}

    pid_t process_;
    std::optional<int> exit_code_;
    double cpu_s_ = 0;
};

/// @returns CPU time that the process has taken, s; nothing if it is not there any more
std::optional<double> cpu_time_of(pid_t process);

}  // namespace urgengo::cli
