// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/commands/cmd_bench_tracking.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "host/config/file_text.h"
#include "host/config/limits.h"
#include "tools/bench/measure/tracking_table.h"
#include "tools/bench/smoke/bench_plan.h"
#include "tools/bench/smoke/bench_program.h"
#include "tools/log/log.h"
#include "tools/results.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/paths.h"
#include "tools/urgengo/program/run_process.h"
#include "tools/urgengo/progress_bar.h"
#include "tools/urgengo/temporary_folder.h"
#include "urgengo_build_info.h"

namespace urgengo::cli {
namespace {

struct TrackingPaths {
    std::string program, interposer, folder;

    std::string json() const { return folder + "/run.json"; }
    std::string config() const { return folder + "/config.json"; }
    std::string stats() const { return folder + "/stats.json"; }
};

Environment environment_for(bool bare, const TrackingPaths& paths) {
    Environment environment =
        bare ? bare_environment(current_environment(), paths.interposer)
             : environment_with(paths.interposer, paths.config(), "enforce", paths.stats());
    // For all rows: a closed gate must not stand in the way of another stream.
    environment.try_emplace("CUDA_DEVICE_MAX_CONNECTIONS",
                            std::to_string(config::kConnections.max));
    return environment;
}

std::vector<std::string> program_arguments(const BenchTrackingOptions& options,
                                           const TrackingPaths& paths) {
    return {paths.program, "tracking",
            "--kernel-us", fmt::format("{}", fmt::join(options.kernel_us, ",")),
            "--json",      paths.json()};
}

Result<std::vector<unsigned>> calibrate(const BenchTrackingOptions& options,
                                        const TrackingPaths& paths) {
    auto arguments = program_arguments(options, paths);
    arguments.push_back("--calibrate");
    ProgressBar bar;
    bar.show(-1, "calibrating the kernels");
    const auto ran = run_to_end(arguments, environment_for(true, paths));
    if (!ran) return Error{ran.error()};
    const auto json = read_json(paths.json());
    if (!json) return Error{json.error()};
    return json->at("iterations").get<std::vector<unsigned>>();
}

Result<std::vector<TrackingCellRun>> run_once(const std::string& row, const TrackingPaths& paths,
                                              TrackingBench& bench) {
    const BenchTrackingOptions& options = bench.options;
    const bool bare = row == kBareRow;
    if (!bare) {
        const std::string wrong = bench::write_config(paths.config(), plan_config(options, row));
        if (!wrong.empty()) return Error{wrong};
    }
    std::vector<int> launches;
    for (const double us : options.kernel_us) launches.push_back(frame_launches(us));
    auto arguments = program_arguments(options, paths);
    arguments.insert(arguments.end(),
                     {"--iterations", fmt::format("{}", fmt::join(bench.iterations, ",")),
                      "--frame-launches", fmt::format("{}", fmt::join(launches, ",")),
                      "--situations", fmt::format("{}", fmt::join(options.situations, ",")),
                      "--seconds", fmt::format("{}", options.seconds)});
    const auto ran = run_to_end(arguments, environment_for(bare, paths));
    if (!ran) return Error{ran.error()};
    const auto json = read_json(paths.json());
    if (!json) return Error{json.error()};
    // A row that was not scheduled must not pass for one that was, nor the other way round.
    const auto saw = json->at("urgengo").get<std::string>();
    const std::string must_see = bare ? "not loaded" : "scheduling";
    if (saw != must_see)
        return Error{fmt::format("the program saw UrgenGo {}, accepted: {}", saw, must_see)};
    bench.gpu = json->at("gpu").get<std::string>();
    bench.cuda = json->at("cuda").get<std::string>();
    const auto stats = bare ? Result<std::string>("") : config::read_file(paths.stats());
    if (!stats) return Error{stats.error()};
    return parse_tracking_run(json->dump(), *stats, bench.cells);
}

/// @returns what went wrong; an empty text if it was interrupted
Result<bool> carry_out(const TrackingPaths& paths, TrackingBench& bench) {
    const auto& rows = bench.options.rows;
    bench.runs.resize(rows.size());
    ProgressBar bar;
    for (int round = 1; round <= bench.options.rounds; ++round)
        for (std::size_t r = 0; r < rows.size(); ++r) {
            tools::log_info("[{}/{}] {}", round, bench.options.rounds, rows[r]);
            bar.show_step(static_cast<std::size_t>(round - 1) * rows.size() + r,
                          static_cast<std::size_t>(bench.options.rounds) * rows.size(), rows[r]);
            auto run = run_once(rows[r], paths, bench);
            if (!run) return Error{run.error().empty() ? "" : rows[r] + ": " + run.error()};
            bench.runs[r].push_back(std::move(*run));
        }
    return true;
}

}  // namespace

CLI::App* add_bench_tracking(CLI::App& bench, BenchTrackingOptions& options) {
    CLI::App* command = bench.add_subcommand(
        "tracking", "What knowing the executing kernel costs, in GPU time and CPU time a launch");
    command->add_option("--kernel-us", options.kernel_us, "Periods of kernels")
        ->delimiter(',')
        ->check(CLI::Range(1.0, 1e4))
        ->capture_default_str();
    command->add_option("--rows", options.rows, "bare, or a preset, with + what is changed")
        ->delimiter(',')
        ->capture_default_str();
    command->add_option("--situations", options.situations, "Of the chain: alone, beside another")
        ->delimiter(',')
        ->check(CLI::IsMember({bench::kAlone, bench::kBeside}))
        ->capture_default_str();
    command
        ->add_option("--eval-interval-us", options.eval_interval_us,
                     "Of rows with a way of tracking [the config's default]")
        ->check(CLI::Range(config::kEvalIntervalUs.min, config::kEvalIntervalUs.max));
    command->add_option("--chains", options.chains, "Idle ones in the config")
        ->check(CLI::Range(0, 60))
        ->capture_default_str();
    command->add_option("--rounds", options.rounds, "Runs of each row, in turns")
        ->check(CLI::Range(1, 1000))
        ->capture_default_str();
    command->add_option("--seconds", options.seconds, "Of each kernel and situation in a run")
        ->check(CLI::Range(0.01, 600.0))
        ->capture_default_str();
    command
        ->add_option("--iterations", options.iterations,
                     "What the kernels do, one number each, instead of calibrating")
        ->delimiter(',');
    command->add_option("--out", options.out, "Write every run as JSON");
    return command;
}

int cmd_bench_tracking(const BenchTrackingOptions& options,
                       const std::vector<std::string>& arguments) {
    const std::string wrong = check(options);
    if (!wrong.empty()) return fail(kExitUsage, wrong);
    const auto program = launch_bench_program();
    if (!program) return fail(kExitUsage, program.error());
    const auto interposer = interposer_library();
    if (!interposer) return fail(kExitUsage, interposer.error());
    const auto folder = TemporaryFolder::make();
    if (!folder) return fail(kExitFailure, folder.error());
    const TrackingPaths paths{*program, *interposer, (*folder)->path()};

    std::vector<std::string> command{"urgengo"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    TrackingBench bench;
    bench.options = options;
    bench.cells = plan_cells(options);
    bench.driver = driver_version();
    bench.version = kVersion;
    bench.commit = kCommit;
    bench.date_utc = utc_now();
    bench.command_line = command_line_for_results(command);
    const auto iterations = options.iterations.empty()
                                ? calibrate(options, paths)
                                : Result<std::vector<unsigned>>(options.iterations);
    if (!iterations) return end_of_runs(iterations.error());
    bench.iterations = *iterations;
    const auto ran = carry_out(paths, bench);
    if (!ran) return end_of_runs(ran.error());

    fmt::print("GPU: {}\n{} s a cell, {} rounds: median (min..max)\n\n{}", bench.gpu,
               options.seconds, options.rounds, format_tracking_table(bench));
    return write_results(options.out, to_json(bench));
}

}  // namespace urgengo::cli
