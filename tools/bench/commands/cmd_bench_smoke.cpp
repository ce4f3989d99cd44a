// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/commands/cmd_bench_smoke.h"

#include <fmt/format.h>

#include <filesystem>
#include <system_error>

#include "host/base/hash.h"
#include "host/config/file_text.h"
#include "host/config/hex.h"
#include "host/config/limits.h"
#include "tools/bench/smoke/bench_json.h"
#include "tools/bench/smoke/bench_merge.h"
#include "tools/bench/smoke/bench_runner.h"
#include "tools/bench/smoke/bench_setup.h"
#include "tools/bench/smoke/bench_table.h"
#include "tools/bench/smoke/html_report.h"
#include "tools/log/log.h"
#include "tools/results.h"
#include "tools/urgengo/exit_codes.h"
#include "urgengo_build_info.h"

namespace urgengo::cli {

CLI::App* add_bench_smoke(CLI::App& bench, BenchOptions& options) {
    CLI::App* command = bench.add_subcommand(
        "smoke", "The ten-chain workload at a few loads, in about two minutes");
    add_bench_options(*command, options);
    command
        ->add_option(
            "--rows", options.rows,
            "What to compare: bare; floor: bare, but each chain alone, one after the other, with "
            "its "
            "own arrivals, so that what is missed cannot be met (a run of each chain: as many "
            "times as long); or a preset; after it +batched, say: tracking (or "
            "progress.source) is that; +batched@100: with this evaluation interval, in us; "
            "+every=20: progress.every_us; +learn: progress.learn is on; +pack_limit=0.8: that "
            "key of `scheduler:`; +nice=-15: that of `cpu:`; +noise=30: the estimated "
            "GPU times of each task are multiplied by a factor of its own, uniform in 0.7 to 1.3, "
            "drawn from the run's seed, for the whole run; several of them may follow each other; "
            "with -nohints at the end the program says nothing of its frames")
        ->delimiter(',')
        ->capture_default_str();
    command
        ->add_option(
            "--profile", options.profile,
            "A profile from `urgengo profile`, for rows with hints, instead of learning one")
        ->check(CLI::ExistingFile);
    command
        ->add_option("--profile-nohints", options.profile_nohints,
                     "The same for rows without hints")
        ->check(CLI::ExistingFile);
    command
        ->add_option("--eval-interval-us", options.eval_interval_us,
                     "Of rows with +batched or +overlapped and no @: estimated GPU time of a batch")
        ->check(CLI::Range(config::kEvalIntervalUs.min, config::kEvalIntervalUs.max));
    command->add_option("--threads", options.threads, "One thread for each: chain, task");
    command
        ->add_option("--frees", options.frees,
                     "Tasks that free device memory in every frame, which waits for all GPU work")
        ->capture_default_str();
    command->add_option("--html", options.html, "Write a report to look at");
    command->add_option("--keep", options.keep,
                        "Copy the runs' files there: workload, configs, profiles, reports");
    command
        ->add_option("--merge", options.merge,
                     "Run nothing: take the results in these JSON files, of other seeds, rows or "
                     "loads under the same conditions, as if they came from one bench")
        ->delimiter(',')
        ->check(CLI::ExistingFile);
    return command;
}

namespace {

int show(const BenchOptions& options, const BenchResults& results) {
    fmt::print("{}", format_table(results));
    const bool json_written = write_report(options.out, to_json(results));
    const bool html_written = write_report(options.html, html_report(results));
    return json_written && html_written ? 0 : kExitFailure;
}

int merge(const BenchOptions& options) {
    std::vector<std::string> texts;
    for (const std::string& file : options.merge) {
        const auto text = config::read_file(file);
        if (!text) return fail(kExitUsage, text.error());
        texts.push_back(*text);
    }
    const auto merged = merge_results(texts, options.merge);
    if (!merged) return fail(kExitUsage, "--merge: " + merged.error());
    fmt::print("{}\n\n", merged->gpu_line);
    return show(options, *merged);
}

/// @returns what is wrong; empty if nothing is
std::string keep_files(const std::string& from, const std::string& to) {
    namespace fs = std::filesystem;
    std::error_code error;
    fs::create_directories(to, error);
    if (!error)
        fs::copy(from, to, fs::copy_options::recursive | fs::copy_options::overwrite_existing,
                 error);
    return error ? to + ": cannot be written: " + error.message() : "";
}

}  // namespace

int cmd_bench_smoke(const BenchOptions& options, const std::vector<std::string>& arguments) {
    if (!options.merge.empty()) return merge(options);
    BenchSetup setup;
    BenchObstacle obstacle;
    if (!prepare_bench(options, setup, obstacle)) {
        return fail(obstacle.exit_code, obstacle.message);
    }
    const auto outcome = carry_out(setup.plan, setup.environment);
    if (!outcome) return fail(kExitFailure, outcome.error());
    if (!options.keep.empty()) {
        const std::string wrong = keep_files(setup.folder->path(), options.keep);
        if (!wrong.empty()) tools::log_error("{}", wrong);
    }
    if (outcome->interrupted) return fail(kExitInterrupted, "interrupted");

    const auto workload = config::read_file(setup.plan.workload);
    Arguments command{"urgengo"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    const BenchResults results{setup.gpu.simulated,
                               setup.gpu.line,
                               kVersion,
                               kCommit,
                               utc_now(),
                               command_line_for_results(command),
                               list_parameters(options),
                               workload ? config::to_hex(fnv1a64(*workload)) : "",
                               options.rows,
                               options.f_a,
                               outcome->profiles,
                               outcome->runs};
    fmt::print("{} s a run, {} {}, seed {}, {}\n\n", options.seconds, options.repeats,
               options.repeats == 1 ? "run each" : "runs each: median (min..max)", options.seed,
               "miss % is the mean of the chains' miss ratios");
    return show(options, results);
}

}  // namespace urgengo::cli
