// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/commands/cmd_bench_latency.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <numeric>

#include "host/base/hash.h"
#include "host/config/file_text.h"
#include "host/config/hex.h"
#include "host/config/presets.h"
#include "tools/bench/measure/latency_merge.h"
#include "tools/bench/smoke/bench_json.h"
#include "tools/bench/smoke/bench_program.h"
#include "tools/bench/smoke/bench_runner.h"
#include "tools/bench/smoke/bench_setup.h"
#include "tools/results.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/paths.h"
#include "tools/urgengo/text_table.h"
#include "urgengo_build_info.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kColumns[] = {"p50", "p90", "p99", "p99.99", "max", "mean"};

/// @param times  nanoseconds
void add_row(TextTable& table, const std::string& name, const Json& times) {
    const auto count = times.at("count").get<std::uint64_t>();
    if (count == 0) return;
    std::vector<std::string> cells{name, std::to_string(count)};
    for (const char* column : kColumns)
        cells.push_back(fmt::format("{:.2f}", times.at(column).get<double>() / 1e3));
    table.add_row(std::move(cells));
}

/// What the run's report says but for its instances, of which there may be a hundred thousand.
Json without_instances(const std::string& report) {
    Json json = Json::parse(report);
    for (Json& chain : json.at("chains")) chain.erase("records");
    return json;
}

/// Every number of the histograms would get a line of its own.
std::string text_of(const Json& root) {
    return root.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

int merge(const BenchLatencyOptions& options) {
    std::vector<std::string> texts;
    for (const std::string& file : options.merge) {
        const auto text = config::read_file(file);
        if (!text) return fail(kExitUsage, text.error());
        texts.push_back(*text);
    }
    const auto merged = merge_latencies(texts, options.merge);
    if (!merged) return fail(kExitUsage, "--merge: " + merged.error());
    const Json& parameters = merged->at("parameters");
    for (const Json& run : merged->at("runs")) {
        const auto table = format_latencies(run.at("own_time"));
        if (!table) return fail(kExitUsage, "--merge: " + table.error());
        const auto ratios = run.at("miss_ratios").get<std::vector<double>>();
        fmt::print("\nf_a {}, {} runs of {} s, seeds {}, preset {}: {:.2f} % missed\n{}",
                   run.at("f_a").get<double>(), ratios.size(), parameters.value("seconds", "?"),
                   fmt::join(run.at("seeds").get<std::vector<std::uint64_t>>(), " "),
                   parameters.value("preset", "?"),
                   100 * std::accumulate(ratios.begin(), ratios.end(), 0.0) /
                       static_cast<double>(ratios.size()),
                   *table);
    }
    return write_results(options.bench.out, text_of(*merged));
}

}  // namespace

Result<std::string> format_latencies(const Json& own_time) {
    TextTable table;
    std::vector<std::string> heads{"us", "count"};
    heads.insert(heads.end(), std::begin(kColumns), std::end(kColumns));
    table.add_row(std::move(heads));
    try {
        for (const auto& [name, call] : own_time.at("calls").items()) {
            add_row(table, name + ": added", call.at("added_ns"));
            add_row(table, name + ": held", call.at("held_ns"));
        }
        const Json& instances = own_time.at("instances");
        add_row(table, "instance: added", instances.at("added_ns"));
        add_row(table, "instance: of it deciding", instances.at("deciding_ns"));
        add_row(table, "instance: of it marks", instances.at("our_driver_ns"));
        add_row(table, "instance: held", instances.at("held_ns"));
    } catch (const Json::exception& error) {
        return Error{std::string("the library's own time: ") + error.what()};
    }
    return table.text();
}

CLI::App* add_bench_latency(CLI::App& bench, BenchLatencyOptions& options) {
    options.bench.f_a = {0.9};
    options.bench.seconds = 25 * 60;
    CLI::App* command = bench.add_subcommand(
        "latency",
        "What UrgenGo adds to every kind of call and to every instance of the ten-chain workload, "
        "up to the maximum; holds apart. The count of a percentile is of calls: p99.99 of less "
        "than 10,000 is the maximum");
    add_bench_options(*command, options.bench);
    command
        ->add_option("--profile", options.bench.profile,
                     "A profile from `urgengo profile`, instead of learning one")
        ->check(CLI::ExistingFile);
    command->add_option("--preset", options.preset, "How UrgenGo schedules")->capture_default_str();
    add_own_time_option(*command, options.bench.interposer);
    command
        ->add_option("--merge", options.merge,
                     "Run nothing: add up the histograms in these JSON files, of other seeds under "
                     "the same conditions (one --workload), as if of one run")
        ->delimiter(',')
        ->check(CLI::ExistingFile);
    return command;
}

int cmd_bench_latency(BenchLatencyOptions options, const std::vector<std::string>& arguments) {
    if (!options.merge.empty()) return merge(options);
    if (!config::preset(options.preset))
        return fail(kExitUsage, "--preset: found '" + options.preset +
                                    "', accepted: " + config::preset_names());
    if (const auto found = find_own_time_library(options.bench.interposer); !found)
        return fail(kExitUsage, found.error());
    options.bench.rows = {options.preset};
    BenchSetup setup;
    BenchObstacle obstacle;
    if (!prepare_bench(options.bench, setup, obstacle))
        return fail(obstacle.exit_code, obstacle.message);
    const auto outcome = carry_out(setup.plan, setup.environment);
    if (!outcome) return fail(kExitFailure, outcome.error());
    if (outcome->interrupted) return fail(kExitInterrupted, "interrupted");

    Json runs = Json::array();
    for (std::size_t i = 0; i < outcome->runs.size(); ++i) {
        const RunResult& run = outcome->runs[i];
        const auto own_time = read_json(setup.plan.runs[i].stats + ".own_time.json");
        if (!own_time)
            return fail(kExitFailure, own_time.error() +
                                          ", accepted: a library that measures itself "
                                          "(--own-time-interposer)");
        const auto table = format_latencies(*own_time);
        if (!table) return fail(kExitFailure, table.error());
        fmt::print("\nf_a {}, {} s, seed {}, preset {}: {:.2f} % missed\n{}", run.f_a,
                   options.bench.seconds, run.seed, options.preset, run.miss_pct, *table);
        runs.push_back({{"f_a", run.f_a},
                        {"seed", run.seed},
                        {"report", without_instances(run.report)},
                        {"stats", Json::parse(run.stats, nullptr, false)},
                        {"own_time", *own_time}});
    }
    Arguments command{"urgengo"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    Json parameters = Json::object();
    for (const auto& [name, value] : list_parameters(options.bench)) parameters[name] = value;
    parameters.erase("rows");
    parameters["preset"] = options.preset;
    const auto workload = config::read_file(setup.plan.workload);
    const Json root = {{"format_version", 1},
                       {"program", "urgengo bench latency"},
                       {"gpu", outcome->runs.front().gpu},
                       {"simulated_gpu", setup.gpu.simulated},
                       {"driver", outcome->runs.front().driver},
                       {"version", kVersion},
                       {"commit", kCommit},
                       {"date_utc", utc_now()},
                       {"command_line", command_line_for_results(command)},
                       {"parameters", std::move(parameters)},
                       {"workload_hash", workload ? config::to_hex(fnv1a64(*workload)) : ""},
                       {"profiles", profiles_json(outcome->profiles)},
                       {"runs", std::move(runs)}};
    return write_results(options.bench.out, text_of(root));
}

}  // namespace urgengo::cli
