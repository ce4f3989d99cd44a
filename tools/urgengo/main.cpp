// SPDX-License-Identifier: Apache-2.0
//
// urgengo: the command line tool. One file a command; this one only parses and dispatches.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <exception>
#include <string>
#include <vector>

#include "tools/urgengo/cmd_bench_calls.h"
#include "tools/urgengo/cmd_bench_instances.h"
#include "tools/urgengo/cmd_bench_smoke.h"
#include "tools/urgengo/cmd_run.h"
#include "tools/urgengo/exit_codes.h"
#include "urgengo_build_info.h"

namespace urgengo::cli {
namespace {

constexpr char kCommands[] =
    "accepted: urgengo run, urgengo bench smoke, urgengo bench instances, urgengo bench calls";
constexpr char kRunUsage[] = "accepted: urgengo run [options] -- program [args...]";

/// @returns `fail`'s code, after one line for wrong usage; 0 after --help and --version
int report(const CLI::App& app, const CLI::ParseError& error) {
    if (error.get_exit_code() == static_cast<int>(CLI::ExitCodes::Success)) return app.exit(error);
    // CLI11 says "A subcommand is required", even if there is one that it does not know.
    if (error.get_name() == "RequiredError") {
        return fail(kExitUsage, std::string("no such command, ") + kCommands);
    }
    return fail(kExitUsage, std::string(error.what()) + " (urgengo --help lists what is accepted)");
}

/// @param extras  what the parser did not know
int start(const RunOptions& options, const std::vector<std::string>& extras,
          const std::vector<std::string>& program) {
    if (!extras.empty()) {
        const char* what = extras[0].starts_with("-") ? "unknown option '" : "found '";
        return fail(kExitUsage, what + extras[0] + "', " + kRunUsage);
    }
    if (program.empty()) return fail(kExitUsage, std::string("no program, ") + kRunUsage);
    return cmd_run(options, program);
}

int dispatch(std::vector<std::string> arguments) {
    // The program's own arguments are none of the parser's business.
    const auto separator = std::find(arguments.begin(), arguments.end(), "--");
    const bool has_separator = separator != arguments.end();
    const std::vector<std::string> program(has_separator ? separator + 1 : separator,
                                           arguments.end());
    std::vector<std::string> own(arguments.begin(), separator);

    CLI::App app("UrgenGo makes unmodified GPU programs meet their deadlines.", "urgengo");
    app.set_version_flag("--version", fmt::format("urgengo {} ({})", kVersion, kCommit));
    app.require_subcommand(1);
    RunOptions run_options;
    CLI::App* run = add_run(app, run_options);
    run->allow_extras();  // for a message of our own when "--" is forgotten
    BenchOptions bench_options;
    CLI::App* bench = app.add_subcommand("bench", "Measure misses, bare and under UrgenGo");
    bench->require_subcommand(1);
    CLI::App* smoke = add_bench_smoke(*bench, bench_options);
    InstancesOptions instances_options;
    CLI::App* instances = add_bench_instances(*bench, instances_options);
    BenchCallsOptions calls_options;
    CLI::App* calls = add_bench_calls(*bench, calls_options);

    std::reverse(own.begin(), own.end());  // CLI11 takes arguments from the back
    try {
        app.parse(own);
    } catch (const CLI::ParseError& error) {
        return report(app, error);
    }
    if (run->parsed()) return start(run_options, run->remaining(), program);
    if (has_separator) return fail(kExitUsage, "found '--', accepted: only after urgengo run");
    if (instances->parsed()) return cmd_bench_instances(instances_options, arguments);
    if (calls->parsed()) return cmd_bench_calls(calls_options, arguments);
    return smoke->parsed() ? cmd_bench_smoke(bench_options, arguments) : kExitUsage;
}

}  // namespace
}  // namespace urgengo::cli

int main(int argc, char** argv) {
    using namespace urgengo::cli;
    try {
        return dispatch(std::vector<std::string>(argv + 1, argv + argc));
    } catch (const std::exception& error) {
        return fail(kExitFailure, error.what());
    }
}
