// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/commands/cmd_bench_throughput.h"

#include <fmt/format.h>

#include <set>

#include "tools/bench/measure/throughput_bench.h"
#include "tools/bench/smoke/bench_program.h"
#include "tools/log/log.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/progress_bar.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

/// @returns what is wrong with the options; empty if nothing is
std::string check(const BenchThroughputOptions& options) {
    std::set<std::string> rows;
    for (const std::string& name : options.rows) {
        const Row row = parse_row(name);
        if (const std::string wrong = check_row(name); !wrong.empty()) return wrong;
        if (!row.hints || !row.variant.empty())
            return "--rows: found '" + name + "', accepted: bare, or a preset as it is";
        if (!rows.insert(name).second) return "--rows: found '" + name + "' twice, accepted: once";
    }
    return {};
}

struct ThroughputOutcome {
    std::vector<ThroughputLevel> levels;
    Json runs = Json::array();  ///< every run's own report and statistics
};

/// @errors an empty text if it was interrupted
Result<ThroughputOutcome> carry_out(EqualChains& chains, const BenchThroughputOptions& options) {
    ThroughputOutcome outcome;
    const std::size_t steps =
        options.f_a.size() * static_cast<std::size_t>(options.runs.rounds) * options.rows.size();
    ProgressBar bar;
    for (const double f_a : options.f_a) {
        ThroughputLevel level{f_a, options.rows, {}};
        level.instances_per_s.resize(options.rows.size());
        for (int round = 0; round < options.runs.rounds; ++round)
            for (std::size_t r = 0; r < options.rows.size(); ++r) {
                const std::string& row = options.rows[r];
                const auto seed = options.runs.seed + static_cast<std::uint32_t>(round);
                bar.show_step(outcome.runs.size(), steps, fmt::format("f_a {}, {}", f_a, row));
                const auto run = chains.run({row, options.chains, f_a, seed});
                if (!run) return Error{run.error()};
                const auto& found = run->report.at("throughput");
                const double per_s = found.at("instances_per_s").get<double>();
                tools::log_info("[f_a {}, {}/{}] {}: {:.2f} instances/s", f_a, round + 1,
                                options.runs.rounds, row, per_s);
                if (found.at("finished") == 0)
                    return Error{row + ": no instance was finished (a longer --seconds?)"};
                level.instances_per_s[r].push_back(per_s);
                outcome.runs.push_back({{"row", row},
                                        {"f_a", f_a},
                                        {"seed", seed},
                                        {"report", run->report},
                                        {"stats", run->stats}});
            }
        outcome.levels.push_back(std::move(level));
    }
    return outcome;
}

}  // namespace

CLI::App* add_bench_throughput(CLI::App& bench, BenchThroughputOptions& options) {
    CLI::App* command = bench.add_subcommand(
        "throughput", "Instances a second of equal chains without deadlines (copies of C3)");
    add_equal_chains_options(*command, options.runs);
    command->add_option("--f-a", options.f_a, "Factors on arrival rates")
        ->delimiter(',')
        ->check(CLI::Range(0.01, 100.0))
        ->capture_default_str();
    command
        ->add_option("--rows", options.rows,
                     "What to compare: bare, or a preset; ratios are to vanilla, else to the first")
        ->delimiter(',')
        ->capture_default_str();
    command->add_option("--chains", options.chains, "Copies of C3")
        ->check(CLI::Range(1, 32))
        ->capture_default_str();
    return command;
}

int cmd_bench_throughput(const BenchThroughputOptions& options,
                         const std::vector<std::string>& arguments) {
    const std::string wrong = check(options);
    if (!wrong.empty()) return fail(kExitUsage, wrong);
    EqualChains chains;
    BenchObstacle obstacle;
    if (!chains.prepare(options.runs, obstacle)) return fail(obstacle.exit_code, obstacle.message);
    if (const auto learned = chains.learn(); !learned) return end_of_runs(learned.error());
    const auto outcome = carry_out(chains, options);
    if (!outcome) return end_of_runs(outcome.error());

    fmt::print("{} copies of {}, {} s a run, {} rounds: median (min..max)\n", options.chains,
               kEqualChain, options.runs.seconds, options.runs.rounds);
    Json levels = Json::array();
    for (const ThroughputLevel& level : outcome->levels) {
        fmt::print("\n{}", format_throughput(level));
        levels.push_back(throughput_json(level));
    }
    Json root = record_of("urgengo bench throughput", chains, options.runs,
                          outcome->runs.front().at("report"), arguments);
    root["chains"] = options.chains;
    root["levels"] = std::move(levels);
    root["runs"] = outcome->runs;
    return write_results(options.runs.out,
                         root.dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
}

}  // namespace urgengo::cli
