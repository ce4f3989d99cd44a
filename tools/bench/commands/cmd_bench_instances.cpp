// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/commands/cmd_bench_instances.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <nlohmann/json.hpp>

#include "host/config/config_reader.h"
#include "host/config/presets.h"
#include "tools/bench/measure/instance_records.h"
#include "tools/bench/measure/instances_report.h"
#include "tools/bench/smoke/bench_json.h"
#include "tools/bench/smoke/bench_runner.h"
#include "tools/bench/smoke/bench_setup.h"
#include "tools/results.h"
#include "tools/trace/trace_reader.h"
#include "tools/urgengo/exit_codes.h"
#include "urgengo_build_info.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

/// Compares one run's instances with its frames, and adds the result to `level`.
/// @errors what is wrong with the run's files; a trace that is not whole is
Result<bool> add_run(const RunResult& run, std::size_t skip_first, InstancesLevel& level) {
    const auto frames = parse_true_frames(run.report, "report of the run");
    if (!frames) return Error{frames.error()};
    const auto trace = trace::read_trace(run.trace);
    if (!trace) return Error{trace.error()};
    if (!trace->warnings().empty()) return Error{trace->warnings().front()};
    const auto config = config::read_config(run.yaml);
    if (!config) return Error{config.error()};
    auto detected = detected_instances(*trace, *config);
    if (!detected) return Error{detected.error()};

    level.miss_pct.push_back(run.miss_pct);
    for (const auto& [chain, list] : *frames) {
        level.chains[chain] += match_instances(list, (*detected)[chain], skip_first);
    }
    return true;
}

Result<std::vector<InstancesLevel>> compare(const BenchOutcome& outcome,
                                            const InstancesOptions& options) {
    std::vector<InstancesLevel> levels;
    for (const double f_a : options.bench.f_a) {
        InstancesLevel level;
        level.f_a = f_a;
        for (const RunResult& run : outcome.runs) {
            if (run.f_a != f_a) continue;
            const auto added = add_run(run, options.skip_first, level);
            if (!added) return Error{added.error()};
        }
        levels.push_back(std::move(level));
    }
    return levels;
}

std::string to_json(const InstancesOptions& options, const BenchSetup& setup,
                    const BenchOutcome& outcome, const std::vector<InstancesLevel>& levels,
                    const std::vector<std::string>& arguments) {
    Arguments command{"urgengo"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    Json parameters = Json::object();
    for (const auto& [name, value] : list_parameters(options.bench)) parameters[name] = value;
    Json list = Json::array();
    for (const InstancesLevel& level : levels) list.push_back(instances_json(level));
    const RunResult& first = outcome.runs.front();
    const Json root = {{"format_version", 1},
                       {"program", "urgengo bench instances"},
                       {"gpu", first.gpu},
                       {"simulated_gpu", setup.gpu.simulated},
                       {"driver", first.driver},
                       {"version", kVersion},
                       {"commit", kCommit},
                       {"date_utc", utc_now()},
                       {"command_line", command_line_for_results(command)},
                       {"parameters", std::move(parameters)},
                       {"profiles", profiles_json(outcome.profiles)},
                       {"skip_first", options.skip_first},
                       {"tolerance_us", kMatchTolerance.count()},
                       {"levels", std::move(list)}};
    return root.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

void print(const InstancesOptions& options, const std::vector<InstancesLevel>& levels) {
    const BenchOptions& bench = options.bench;
    fmt::print("{} s a run, {} run{}, seed {}, preset {}; ", bench.seconds, bench.repeats,
               bench.repeats == 1 ? "" : "s", bench.seed, options.preset);
    if (options.skip_first == 0) fmt::print("every frame counts, from the first\n");
    if (options.skip_first != 0) {
        fmt::print("the first {} frames of each chain and run do not count\n", options.skip_first);
    }
    fmt::print(
        "per cent of the true instances (resyncs, observed only: of the detected); begin, end, "
        "arrival:\nerror in us, median / 95 % / max of the magnitude\n");
    for (const InstancesLevel& level : levels) {
        fmt::print("\n{}", format_instances(level));
        fmt::print("deadlines missed, run by run: {:.1f} %\n", fmt::join(level.miss_pct, " %, "));
    }
}

}  // namespace

CLI::App* add_bench_instances(CLI::App& bench, InstancesOptions& options) {
    CLI::App* command = bench.add_subcommand(
        "instances", "Without hints: instances as detected, against the frames there were");
    add_bench_options(*command, options.bench);
    command
        ->add_option("--profile", options.bench.profile_nohints,
                     "A profile from `urgengo profile`, instead of learning one")
        ->check(CLI::ExistingFile);
    command->add_option("--preset", options.preset, "How UrgenGo schedules meanwhile")
        ->capture_default_str();
    command
        ->add_option("--skip-first", options.skip_first,
                     "Frames of each chain and run that do not count")
        ->capture_default_str();
    return command;
}

int cmd_bench_instances(InstancesOptions options, const std::vector<std::string>& arguments) {
    if (!config::preset(options.preset)) {
        return fail(kExitUsage, "--preset: found '" + options.preset +
                                    "', accepted: " + config::preset_names());
    }
    options.bench.rows = {options.preset + kNoHintsSuffix};
    options.bench.truth = true;
    BenchSetup setup;
    BenchObstacle obstacle;
    if (!prepare_bench(options.bench, setup, obstacle)) {
        return fail(obstacle.exit_code, obstacle.message);
    }
    const auto outcome = carry_out(setup.plan, setup.environment);
    if (!outcome) return fail(kExitFailure, outcome.error());
    if (outcome->interrupted) return fail(kExitInterrupted, "interrupted");
    const auto levels = compare(*outcome, options);
    if (!levels) return fail(kExitFailure, levels.error());
    print(options, *levels);
    return write_report(options.bench.out, to_json(options, setup, *outcome, *levels, arguments))
               ? 0
               : kExitFailure;
}

}  // namespace urgengo::cli
