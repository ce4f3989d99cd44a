// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/commands/cmd_bench_launches.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "host/config/file_text.h"
#include "tools/bench/bench_config.h"
#include "tools/bench/measure/bench_calls.h"
#include "tools/bench/smoke/bench_program.h"
#include "tools/bench/smoke/bench_table.h"
#include "tools/log/log.h"
#include "tools/results.h"
#include "tools/urgengo/environment.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/paths.h"
#include "tools/urgengo/program/run_process.h"
#include "tools/urgengo/progress_bar.h"
#include "tools/urgengo/temporary_folder.h"
#include "tools/urgengo/text_table.h"
#include "urgengo_build_info.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

/// At least this share of the bare throughput.
/// @source the project's goal; a released peer: 0.56
constexpr double kGoal = 0.9;

struct Condition {
    const char* name;
    bool loaded;
    const char* mode;         ///< empty: no config
    const char* thread;       ///< the launching thread's name
    const char* must_report;  ///< what the program must see of UrgenGo
};

constexpr Condition kConditions[] = {
    {"bare", false, "", bench::kMeasuredThread, "not loaded"},
    {"no config", true, "", bench::kMeasuredThread, "loaded, off"},
    {"armed, of no chain", true, "enforce", bench::kBystanderThread, "scheduling"},
    {"observe", true, "observe", bench::kMeasuredThread, "observing"},
    {"scheduled", true, "enforce", bench::kMeasuredThread, "scheduling"},
};
constexpr std::size_t kNumConditions = std::size(kConditions);

struct LaunchPaths {
    std::string program, interposer, folder;

    std::string json() const { return folder + "/run.json"; }
    std::string config() const { return folder + "/config.json"; }
    std::string stats() const { return folder + "/stats.json"; }
};

/// One run of the program: its report, and the measured chain's statistics under "chain".
using Run = Json;
/// Shape [frame_launches][conditions][rounds].
using Runs = std::vector<std::vector<std::vector<Run>>>;

Environment environment_for(const Condition& condition, const LaunchPaths& paths) {
    if (!condition.loaded) return bare_environment(current_environment(), paths.interposer);
    if (!*condition.mode) return environment_with(paths.interposer, "", "", "");
    return environment_with(paths.interposer, paths.config(), condition.mode, paths.stats());
}

std::vector<std::string> program_arguments(const BenchLaunchesOptions& options,
                                           const LaunchPaths& paths, int frame_launches) {
    return {paths.program,
            "--kernel-us",
            fmt::format("{}", options.kernel_us),
            "--frame-launches",
            std::to_string(frame_launches),
            "--chains",
            std::to_string(options.chains)};
}

/// @returns the iterations for a kernel of the time asked for
Result<unsigned> calibrate(const BenchLaunchesOptions& options, const LaunchPaths& paths) {
    auto arguments = program_arguments(options, paths, options.frame_launches.front());
    arguments.insert(arguments.end(), {"--calibrate", "--json", paths.json()});
    ProgressBar bar;
    bar.show(-1, "calibrating the kernels");
    const auto ran = run_to_end(arguments, environment_for(kConditions[0], paths));
    if (!ran) return Error{ran.error()};
    const auto json = read_json(paths.json());
    if (!json) return Error{json.error()};
    tools::log_info("kernels of {} iterations: one every {:.2f} us, bare",
                    json->at("iterations").get<unsigned>(), json->at("period_us").get<double>());
    return json->at("iterations").get<unsigned>();
}

Result<Run> run_once(const Condition& condition, const BenchLaunchesOptions& options,
                     const LaunchPaths& paths, int frame_launches, unsigned iterations) {
    auto arguments = program_arguments(options, paths, frame_launches);
    if (*condition.mode) {
        auto write_config = arguments;
        write_config.insert(write_config.end(), {"--write-config", paths.config()});
        const auto written = run_to_end(write_config, environment_for(kConditions[0], paths));
        if (!written) return Error{written.error()};
    }
    arguments.insert(arguments.end(), {"--iterations", std::to_string(iterations), "--seconds",
                                       fmt::format("{}", options.seconds), "--thread",
                                       condition.thread, "--json", paths.json()});
    const auto ran = run_to_end(arguments, environment_for(condition, paths));
    if (!ran) return Error{ran.error()};
    auto run = read_json(paths.json());
    if (!run) return run;
    // A row that was not scheduled must not pass for one that was, nor the other way round.
    if (run->at("urgengo") != condition.must_report)
        return Error{fmt::format("{}: the program saw UrgenGo {}, accepted: {}", condition.name,
                                 run->at("urgengo").get<std::string>(), condition.must_report)};
    if (!*condition.mode) return run;
    const auto stats = config::read_file(paths.stats());
    if (!stats) return Error{stats.error()};
    if (condition.name == std::string("scheduled")) {
        const std::string wrong = why_not_scheduled(*stats, bench::kMeasured);
        if (!wrong.empty()) return Error{std::string(condition.name) + ": " + wrong};
    }
    const Json parsed = Json::parse(*stats, nullptr, /*allow_exceptions=*/false);
    (*run)["chain"] = parsed.at("chains").at(0);
    return run;
}

Spread over_rounds(const std::vector<Run>& runs, const Json::json_pointer& value) {
    std::vector<double> values;
    for (const Run& run : runs) values.push_back(run.at(value).get<double>());
    return spread(std::move(values));
}

std::string format_runs(const BenchLaunchesOptions& options, const Runs& runs) {
    const Json::json_pointer throughput("/kernels_per_s"), p50("/launch_ns/p50"),
        p99("/launch_ns/p99");
    TextTable table;
    table.add_row({"launches between waits", "condition", "kernels/s", "of bare", "",
                   "launch ns p50", "p99"});
    for (std::size_t f = 0; f < runs.size(); ++f) {
        const double bare = over_rounds(runs[f][0], throughput).median;
        for (std::size_t c = 0; c < kNumConditions; ++c) {
            const Spread rate = over_rounds(runs[f][c], throughput);
            const double share = rate.median / bare;
            table.add_row({std::to_string(options.frame_launches[f]), kConditions[c].name,
                           format_spread(rate, 0), fmt::format("{:.3f}", share),
                           c == 0           ? ""
                           : share >= kGoal ? "met"
                                            : "NOT MET",
                           format_spread(over_rounds(runs[f][c], p50), 0),
                           format_spread(over_rounds(runs[f][c], p99), 0)});
        }
    }
    return table.text();
}

Json to_json(const BenchLaunchesOptions& options, const Runs& runs, unsigned iterations,
             const std::vector<std::string>& command) {
    Json rows = Json::array();
    for (std::size_t f = 0; f < runs.size(); ++f)
        for (std::size_t c = 0; c < kNumConditions; ++c)
            rows.push_back({{"condition", kConditions[c].name},
                            {"frame_launches", options.frame_launches[f]},
                            {"runs", runs[f][c]}});
    const Run& first = runs.front().front().front();
    return {{"format_version", 1},
            {"program", "urgengo bench launches"},
            {"gpu", first.at("gpu")},
            {"cuda", first.at("cuda")},
            {"driver", driver_version()},
            {"version", kVersion},
            {"commit", kCommit},
            {"date_utc", utc_now()},
            {"command_line", command_line_for_results(command)},
            {"kernel_us", options.kernel_us},
            {"iterations", iterations},
            {"chains", options.chains},
            {"rows", std::move(rows)}};
}

/// @errors empty if interrupted
Result<Runs> carry_out(const BenchLaunchesOptions& options, const LaunchPaths& paths,
                       unsigned iterations) {
    Runs runs(options.frame_launches.size(), std::vector<std::vector<Run>>(kNumConditions));
    const std::size_t steps =
        static_cast<std::size_t>(options.rounds) * runs.size() * kNumConditions;
    std::size_t done = 0;
    ProgressBar bar;
    // In turns, so that a machine that changes its pace changes it for all.
    for (int round = 1; round <= options.rounds; ++round)
        for (std::size_t f = 0; f < runs.size(); ++f)
            for (std::size_t c = 0; c < kNumConditions; ++c) {
                tools::log_info("[{}/{}] {} launches, {}", round, options.rounds,
                                options.frame_launches[f], kConditions[c].name);
                bar.show_step(done++, steps, kConditions[c].name);
                auto run =
                    run_once(kConditions[c], options, paths, options.frame_launches[f], iterations);
                if (!run) return Error{run.error()};
                runs[f][c].push_back(std::move(*run));
            }
    return runs;
}

}  // namespace

CLI::App* add_bench_launches(CLI::App& bench, BenchLaunchesOptions& options) {
    CLI::App* command = bench.add_subcommand(
        "launches", "Throughput of small kernels on this GPU, bare and under UrgenGo");
    command->add_option("--kernel-us", options.kernel_us, "Period of the chain of kernels [3]")
        ->check(CLI::Range(1.0, 1e6));
    command
        ->add_option("--frame-launches", options.frame_launches,
                     "Launches between two waits [200,5000]")
        ->delimiter(',')
        ->check(CLI::Range(1, 100'000));
    command->add_option("--chains", options.chains, "In the config; all but one are idle [10]")
        ->check(CLI::Range(1, 63));
    command->add_option("--rounds", options.rounds, "Runs of each kind, in turns [3]")
        ->check(CLI::Range(1, 1000));
    command->add_option("--seconds", options.seconds, "Length of a run [2]")
        ->check(CLI::Range(0.01, 600.0));
    command->add_option("--iterations", options.iterations,
                        "What a kernel does, instead of calibrating");
    command->add_option("--out", options.out, "Write every run as JSON");
    return command;
}

int cmd_bench_launches(const BenchLaunchesOptions& options,
                       const std::vector<std::string>& arguments) {
    const auto program = launch_bench_program();
    if (!program) return fail(kExitUsage, program.error());
    const auto interposer = interposer_library();
    if (!interposer) return fail(kExitUsage, interposer.error());
    const auto folder = TemporaryFolder::make();
    if (!folder) return fail(kExitFailure, folder.error());
    const LaunchPaths paths{*program, *interposer, (*folder)->path()};

    const auto iterations =
        options.iterations > 0 ? Result<unsigned>(options.iterations) : calibrate(options, paths);
    if (!iterations) return end_of_runs(iterations.error());
    const auto runs = carry_out(options, paths, *iterations);
    if (!runs) return end_of_runs(runs.error());

    std::vector<std::string> command{"urgengo"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    const Json json = to_json(options, *runs, *iterations, command);
    fmt::print("GPU: {}\n{} s a run, {} rounds: median (min..max)\n\n{}",
               json.at("gpu").get<std::string>(), options.seconds, options.rounds,
               format_runs(options, *runs));
    return write_results(options.out, json.dump(1) + "\n");
}

}  // namespace urgengo::cli
