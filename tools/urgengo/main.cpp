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
#include "tools/urgengo/cmd_bench_latency.h"
#include "tools/urgengo/cmd_bench_launches.h"
#include "tools/urgengo/cmd_bench_overhead.h"
#include "tools/urgengo/cmd_bench_smoke.h"
#include "tools/urgengo/cmd_bench_throughput.h"
#include "tools/urgengo/cmd_bench_tracking.h"
#include "tools/urgengo/cmd_check.h"
#include "tools/urgengo/cmd_discover.h"
#include "tools/urgengo/cmd_doctor.h"
#include "tools/urgengo/cmd_profile.h"
#include "tools/urgengo/cmd_run.h"
#include "tools/urgengo/cmd_sim.h"
#include "tools/urgengo/exit_codes.h"
#include "urgengo_build_info.h"

namespace urgengo::cli {
namespace {

constexpr char kCommands[] =
    "accepted: urgengo doctor, urgengo discover, urgengo check, urgengo profile, urgengo run, "
    "urgengo sim, urgengo bench smoke, "
    "urgengo bench instances, urgengo bench calls, urgengo bench launches, urgengo bench tracking, "
    "urgengo bench throughput, urgengo bench overhead, "
    "urgengo bench latency";

/// @returns `fail`'s code, after one line for wrong usage; 0 after --help and --version
int report(const CLI::App& app, const CLI::ParseError& error) {
    if (error.get_exit_code() == static_cast<int>(CLI::ExitCodes::Success)) return app.exit(error);
    // CLI11 says "A subcommand is required", even if there is one that it does not know.
    if (error.get_name() == "RequiredError") {
        return fail(kExitUsage, std::string("no such command, ") + kCommands);
    }
    return fail(kExitUsage, std::string(error.what()) + " (urgengo --help lists what is accepted)");
}

/// The commands that start a program take what they do not know for a program without its "--".
/// @returns what is wrong; empty if nothing is
std::string wrong_extras(const CLI::App& command) {
    const std::vector<std::string> extras = command.remaining();
    if (extras.empty()) return {};
    return fmt::format("{}'{}', accepted: urgengo {} [options] -- program [args...]",
                       extras[0].starts_with("-") ? "unknown option " : "found ", extras[0],
                       command.get_name());
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
    DoctorOptions doctor_options;
    CLI::App* doctor = add_doctor(app, doctor_options);
    RunOptions run_options;
    CLI::App* run = add_run(app, run_options);
    DiscoverOptions discover_options;
    CLI::App* discover = add_discover(app, discover_options);
    CheckOptions check_options;
    CLI::App* check = add_check(app, check_options);
    ProfileOptions profile_options;
    CLI::App* profile = add_profile(app, profile_options);
    SimOptions sim_options;
    CLI::App* sim = add_sim(app, sim_options);
    const std::vector<CLI::App*> with_program = {doctor, discover, check, profile, run};
    // For a message of our own when "--" is forgotten.
    for (CLI::App* command : with_program) command->allow_extras();
    BenchOptions bench_options;
    CLI::App* bench = app.add_subcommand("bench", "Measure misses, bare and under UrgenGo");
    bench->require_subcommand(1);
    CLI::App* smoke = add_bench_smoke(*bench, bench_options);
    InstancesOptions instances_options;
    CLI::App* instances = add_bench_instances(*bench, instances_options);
    BenchLaunchesOptions launches_options;
    CLI::App* launches = add_bench_launches(*bench, launches_options);
    BenchTrackingOptions tracking_options;
    CLI::App* tracking = add_bench_tracking(*bench, tracking_options);
    BenchThroughputOptions throughput_options;
    CLI::App* throughput = add_bench_throughput(*bench, throughput_options);
    BenchOverheadOptions overhead_options;
    CLI::App* overhead = add_bench_overhead(*bench, overhead_options);
    BenchLatencyOptions latency_options;
    CLI::App* latency = add_bench_latency(*bench, latency_options);
    BenchCallsOptions calls_options;
    CLI::App* calls = add_bench_calls(*bench, calls_options);

    std::reverse(own.begin(), own.end());  // CLI11 takes arguments from the back
    try {
        app.parse(own);
    } catch (const CLI::ParseError& error) {
        return report(app, error);
    }
    for (const CLI::App* command : with_program) {
        const std::string wrong = command->parsed() ? wrong_extras(*command) : "";
        if (!wrong.empty()) return fail(kExitUsage, wrong);
    }
    if (doctor->parsed()) return cmd_doctor(doctor_options, program);
    if (discover->parsed()) return cmd_discover(discover_options, program);
    if (check->parsed()) return cmd_check(check_options, program);
    if (profile->parsed()) return cmd_profile(profile_options, program);
    if (run->parsed()) {
        if (!program.empty()) return cmd_run(run_options, program);
        return fail(kExitUsage, "no program, accepted: urgengo run [options] -- program [args...]");
    }
    if (has_separator) {
        return fail(
            kExitUsage,
            "found '--', accepted: only after urgengo doctor, discover, check, profile and run");
    }
    if (sim->parsed()) return cmd_sim(sim_options, arguments);
    if (instances->parsed()) return cmd_bench_instances(instances_options, arguments);
    if (calls->parsed()) return cmd_bench_calls(calls_options, arguments);
    if (launches->parsed()) return cmd_bench_launches(launches_options, arguments);
    if (tracking->parsed()) return cmd_bench_tracking(tracking_options, arguments);
    if (throughput->parsed()) return cmd_bench_throughput(throughput_options, arguments);
    if (overhead->parsed()) return cmd_bench_overhead(overhead_options, arguments);
    if (latency->parsed()) return cmd_bench_latency(latency_options, arguments);
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
