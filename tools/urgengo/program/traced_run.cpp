// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/program/traced_run.h"

#include <fmt/format.h>

#include <filesystem>

#include "tools/urgengo/program/environment_check.h"
#include "tools/urgengo/progress_bar.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::seconds kGrace{10};

Environment traced_environment(const ProgramSetup& setup, const Environment& environment,
                               const TracedRun& run) {
    ScheduledProgram scheduled;
    scheduled.interposer = setup.interposer;
    scheduled.config = run.config;
    scheduled.mode = run.mode;
    scheduled.real_libcuda = setup.real_libcuda;
    scheduled.summary = false;
    scheduled.connections = run.connections;
    Environment traced = scheduled_environment(environment, scheduled);
    traced["URGENGO_TRACE"] = run.trace;
    traced["URGENGO_TRACE_KERNELS"] = run.kernels;
    if (!run.cupti.empty()) traced["URGENGO_CUPTI"] = run.cupti;
    return traced;
}

}  // namespace

void add_traced_run_options(CLI::App& command, double& seconds, std::string& real_libcuda) {
    command
        .add_option("--seconds", seconds,
                    "End the program with SIGINT after so long [when it ends]")
        ->check(CLI::Range(0.1, 86400.0));
    command.add_option("--real-libcuda", real_libcuda,
                       "The driver's library, instead of searching for it");
}

Result<TracedOutcome> run_traced(const ProgramSetup& setup, const std::vector<std::string>& program,
                                 const Environment& environment, const TracedRun& run) {
    const Environment traced = traced_environment(setup, environment, run);
    const EnvironmentCheck checked = check_environment(traced);
    if (!checked.error.empty()) return Error{checked.error};
    warn(checked.warnings);
    std::error_code ignored;
    fs::remove(run.trace, ignored);  // or an old one would pass for this run's

    std::vector<std::string> arguments = program;
    arguments[0] = setup.path;
    ProcessOptions options;
    options.show_output = true;
    options.keeps_stdout = run.keeps_stdout;
    options.limit = run.limit;
    options.grace = kGrace;
    ProgressBar bar;
    bar.show(-1, run.what);
    const auto process = run_process(arguments, traced, options);
    if (!process) return Error{process.error()};

    TracedOutcome outcome;
    outcome.ended_by_us = process->timed_out || process->interrupted;
    outcome.interrupted = process->interrupted;
    if (!outcome.ended_by_us) outcome.exit_code = process->exit_code;
    outcome.how = process->timed_out        ? "its time was over"
                  : process->interrupted    ? "it was interrupted"
                  : process->exit_code != 0 ? fmt::format("it exited with {}", process->exit_code)
                                            : "it ended";
    if (!fs::exists(run.trace, ignored)) {
        return Error{
            fmt::format("{}: {}, and no trace was written: it made no CUDA call that "
                        "UrgenGo saw",
                        program[0], outcome.how)};
    }
    return outcome;
}

}  // namespace urgengo::cli
