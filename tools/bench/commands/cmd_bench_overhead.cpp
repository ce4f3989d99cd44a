// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/commands/cmd_bench_overhead.h"

#include <fmt/format.h>

#include <set>

#include "host/config/limits.h"
#include "host/config/presets.h"
#include "tools/bench/measure/overhead_bench.h"
#include "tools/bench/smoke/bench_program.h"
#include "tools/log/log.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/paths.h"
#include "tools/urgengo/progress_bar.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

/// @returns what is wrong with the options; empty if nothing is
std::string check(const BenchOverheadOptions& options) {
    if (!config::preset(options.preset))
        return "--preset: found '" + options.preset + "', accepted: " + config::preset_names();
    const std::set<int> chains(options.chains.begin(), options.chains.end());
    if (chains.size() != options.chains.size())
        return "--chains: found the same number twice, accepted: once";
    return {};
}

struct OverheadOutcome {
    std::vector<OverheadPoint> points;
    Json runs = Json::array();  ///< every run's own report, statistics and times
};

/// @errors an empty text if it was interrupted
Result<OverheadOutcome> carry_out(EqualChains& chains, const BenchOverheadOptions& options) {
    OverheadOutcome outcome;
    for (const int num : options.chains) outcome.points.push_back({num, {}});
    const std::size_t steps = outcome.points.size() * static_cast<std::size_t>(options.runs.rounds);
    ProgressBar bar;
    for (int round = 0; round < options.runs.rounds; ++round)
        for (OverheadPoint& point : outcome.points) {
            const auto seed = options.runs.seed + static_cast<std::uint32_t>(round);
            bar.show_step(outcome.runs.size(), steps, fmt::format("{} chains", point.chains));
            const auto run = chains.run({options.preset, point.chains, options.f_a, seed});
            if (!run) return Error{run.error()};
            if (run->own_time.is_null())
                return Error{
                    "found no time of its own beside the statistics, accepted: a library "
                    "that measures itself (--own-time-interposer)"};
            const auto measured = parse_own_time(run->own_time);
            if (!measured) return Error{measured.error()};
            tools::log_info("[{}/{}] {} chains: {:.2f} us deciding, of {:.0f} instances", round + 1,
                            options.runs.rounds, point.chains, measured->deciding_us,
                            measured->instances);
            point.rounds.push_back(*measured);
            outcome.runs.push_back({{"chains", point.chains},
                                    {"seed", seed},
                                    {"report", run->report},
                                    {"stats", run->stats},
                                    {"own_time", run->own_time}});
        }
    return outcome;
}

}  // namespace

CLI::App* add_bench_overhead(CLI::App& bench, BenchOverheadOptions& options) {
    options.runs.merge_tasks = true;
    options.runs.cpu = "sleep";
    options.runs.sync = "block";
    CLI::App* command = bench.add_subcommand(
        "overhead",
        "What scheduling costs an instance, in decisions, with so many equal chains. Copies of C3 "
        "without deadlines, each with its two tasks made one, so that 40 chains fit into a "
        "config's 256 tasks; CPU segments sleep and waits block, so that threads do not wait for "
        "cores");
    add_equal_chains_options(*command, options.runs);
    command->add_option("--chains", options.chains, "Numbers of chains")
        ->delimiter(',')
        ->check(CLI::Range(1, static_cast<int>(config::kMaxTasks)))
        ->capture_default_str();
    command
        ->add_option("--f-a", options.f_a,
                     "Factor on arrival rates: at 1, more than 6 chains are overload")
        ->check(CLI::Range(0.01, 100.0))
        ->capture_default_str();
    command->add_option("--preset", options.preset, "How UrgenGo schedules")->capture_default_str();
    add_own_time_option(*command, options.runs.interposer);
    return command;
}

int cmd_bench_overhead(BenchOverheadOptions options, const std::vector<std::string>& arguments) {
    const std::string wrong = check(options);
    if (!wrong.empty()) return fail(kExitUsage, wrong);
    if (const auto found = find_own_time_library(options.runs.interposer); !found)
        return fail(kExitUsage, found.error());
    EqualChains chains;
    BenchObstacle obstacle;
    if (!chains.prepare(options.runs, obstacle)) return fail(obstacle.exit_code, obstacle.message);
    if (const auto learned = chains.learn(); !learned) return end_of_runs(learned.error());
    const auto outcome = carry_out(chains, options);
    if (!outcome) return end_of_runs(outcome.error());

    fmt::print(
        "Copies of {}, f_a {}, {} s a run, {} rounds, preset {}: of an instance, median "
        "(min..max) of the rounds\n\n{}",
        kEqualChain, options.f_a, options.runs.seconds, options.runs.rounds, options.preset,
        format_overhead(outcome->points));
    Json root = record_of("urgengo bench overhead", chains, options.runs,
                          outcome->runs.front().at("report"), arguments);
    root["preset"] = options.preset;
    root["f_a"] = options.f_a;
    root.update(overhead_json(outcome->points));
    root["runs"] = outcome->runs;
    return write_results(options.runs.out,
                         root.dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
}

}  // namespace urgengo::cli
