// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/cmd_sim.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <stdexcept>

#include "host/base/hash.h"
#include "host/config/hex.h"
#include "tools/bench/smoke/bench_json.h"
#include "tools/bench/smoke/bench_plan.h"
#include "tools/bench/smoke/bench_setup.h"
#include "tools/bench/smoke/bench_table.h"
#include "tools/chains/files.h"
#include "tools/chains/spec.h"
#include "tools/results.h"
#include "tools/sim/least_misses.h"
#include "tools/sim/world.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/interrupts.h"
#include "tools/urgengo/progress_bar.h"
#include "tools/urgengo/sim_compare.h"
#include "tools/urgengo/sim_gates.h"
#include "tools/urgengo/sim_rows.h"
#include "tools/urgengo/sim_workload.h"
#include "tools/urgengo/text_table.h"
#include "urgengo_build_info.h"

namespace urgengo::cli {
namespace {

/// With more, the table of chains is wider than any screen.
constexpr std::size_t kRowsWithChains = 4;

template <typename T>
bool has_twice(const std::vector<T>& values) {
    return std::set<T>(values.begin(), values.end()).size() != values.size();
}

/// @returns what is wrong with the options; empty if nothing is
std::string check(const SimOptions& options) {
    if (has_twice(options.rows)) return "--rows: found the same row twice, accepted: once";
    if (has_twice(options.f_a)) return "--f-a: found the same factor twice, accepted: once";
    if (has_twice(options.seeds)) return "--seeds: found the same seed twice, accepted: once";
    for (const std::string& row : options.rows)
        if (std::string wrong = check_sim_row(row); !wrong.empty()) return wrong;
    return {};
}

/// What the runs have in common.
struct Simulation {
    const SimOptions& options;
    SimWorkload workload;
    std::vector<std::string> tight;

    chains::Scenario scenario(double level) const {
        return {workload.f_a(level), options.f_d, tight, true};
    }
};

std::chrono::nanoseconds nanoseconds_of(double us) {
    return std::chrono::nanoseconds(std::llround(us * 1000));
}

/// @errors what is wrong with the report that we have written ourselves, or that it was interrupted
Result<SimRun> run_once(const Simulation& simulation, const std::string& row, double f_a,
                        std::size_t repeat, const std::function<void(double)>& progress) {
    const SimOptions& options = simulation.options;
    sim::WorldSettings settings;
    settings.scenario = simulation.scenario(f_a);
    settings.seconds = options.seconds;
    settings.warmup = options.warmup;
    settings.seed = options.seeds[repeat];
    const SimWorkload workload = simulation.workload.at(f_a);
    if (workload.recorded) {
        settings.traits = workload.recorded->traits;
        settings.frames = sim::recorded_frames(workload.workload, settings.scenario,
                                               settings.seconds, settings.seed);
    }
    settings.gpu.num_sms = workload.workload.num_sms;
    settings.cpu.num_cores = options.cores;
    settings.cpu.launch_capacity = options.launch_capacity;
    settings.connections = options.connections;
    settings.bystander = {nanoseconds_of(1000 * options.bystander_ms),
                          nanoseconds_of(1000 * options.bystander_every_ms)};
    if (options.bystander_matmul) settings.bystander = sim::kMatmulBystander;
    settings.parking_every = nanoseconds_of(1000 * options.parking_every_ms);
    settings.stalls = {nanoseconds_of(1000 * options.stall_ms),
                       nanoseconds_of(1000 * options.stall_every_ms)};
    settings.progress = [&](double part) {
        progress(part);
        return !Interrupts::has_come();
    };
    const auto subject = make_sim_row(row, workload, settings.scenario, settings.seed,
                                      nanoseconds_of(options.mark_late_us));
    chains::RunReport report = sim::World(workload.workload, *subject, settings).run();
    if (report.interrupted) return Error{"interrupted: nothing was written"};
    report.version = kVersion;
    report.commit = kCommit;
    report.cuda_driver_version = "simulated";
    report.urgengo = subject->description();
    report.parameters = {{"f_a", fmt::format("{}", f_a)},
                         {"f_d", fmt::format("{}", options.f_d)},
                         {"tight", fmt::format("{}", fmt::join(simulation.tight, ","))},
                         {"seconds", fmt::format("{}", options.seconds)},
                         {"seed", std::to_string(settings.seed)},
                         {"cores", std::to_string(options.cores)}};
    auto result = parse_report(chains::format_json(report, true), "the simulated run");
    if (!result) return Error{result.error()};
    result->row = row;
    result->f_a = f_a;
    result->repeat = static_cast<int>(repeat);
    result->seed = settings.seed;
    return SimRun{*result, subject->gate_counts()};
}

/// @errors what run_once() says
Result<std::vector<SimRun>> run_all(const Simulation& simulation) {
    const SimOptions& options = simulation.options;
    ProgressBar bar(!options.quiet);
    std::vector<SimRun> runs;
    const double num_runs = double(options.rows.size() * options.f_a.size() * options.seeds.size());
    for (const double f_a : options.f_a)
        for (std::size_t repeat = 0; repeat < options.seeds.size(); ++repeat)
            for (const std::string& row : options.rows) {
                const std::string what =
                    fmt::format("{}, f_a {}, seed {}", row, f_a, options.seeds[repeat]);
                auto run = run_once(simulation, row, f_a, repeat, [&](double part) {
                    bar.show((double(runs.size()) + part) / num_runs, what);
                });
                if (!run) return Error{run.error()};
                runs.push_back(std::move(*run));
            }
    return runs;
}

/// The fewest misses first.
void sort_rows(BenchResults& results) {
    const auto mean = [&](const std::string& row) {
        double sum = 0;
        for (const double f_a : results.levels)
            for (const RunResult& run : results.runs)
                if (run.row == row && run.f_a == f_a) sum += run.miss_pct;
        return sum;
    };
    std::stable_sort(results.rows.begin(), results.rows.end(),
                     [&](const std::string& a, const std::string& b) { return mean(a) < mean(b); });
}

/// What was not asked for otherwise is as in the file that is compared with.
void follow(const Measured& measured, SimOptions& options) {
    if (options.rows.empty()) options.rows = measured.rows();
    if (options.f_a.empty()) options.f_a = measured.levels();
    if (options.seeds.empty()) options.seeds = measured.seeds();
    if (options.seconds <= 0) options.seconds = measured.seconds;
    if (options.f_d <= 0) options.f_d = measured.f_d;
    if (options.warmup <= 0) options.warmup = measured.warmup;
}

void complete(SimOptions& options) {
    if (options.rows.empty()) options.rows = {kBareRow, "urgengo"};
    options.rows = expand_rows(options.rows);
    if (options.f_a.empty()) options.f_a = {0.7, 0.9, 1.1};
    if (options.seeds.empty()) options.seeds = {1, 2, 3};
    if (options.seconds <= 0) options.seconds = 10;
    if (options.f_d <= 0) options.f_d = 1;
}

/// `--least`: no scheduler misses fewer.
struct Least {
    double f_a = 0;
    std::uint32_t seed = 0;
    sim::LeastMisses misses;
};

std::vector<Least> find_least(const Simulation& simulation) {
    const SimOptions& options = simulation.options;
    std::vector<Least> list;
    for (const double f_a : options.f_a)
        for (const std::uint32_t seed : options.seeds)
            list.push_back({f_a, seed,
                            sim::least_misses(simulation.workload.workload,
                                              simulation.scenario(f_a), options.seconds, seed)});
    return list;
}

std::string format_least(const std::vector<Least>& list) {
    TextTable table;
    table.add_row({"least miss %", "f_a", "one at a time", "shared"});
    for (const Least& least : list)
        table.add_row({fmt::format("seed {}", least.seed), fmt::format("{}", least.f_a),
                       fmt::format("{:.2f}", 100 * least.misses.one_at_a_time),
                       fmt::format("{:.2f}", 100 * least.misses.shared)});
    return table.text();
}

/// Of the ten chains; a program's own deadlines stay.
std::vector<std::string> tight_of(const SimWorkload& workload, double part) {
    std::vector<std::string> tight;
    if (workload.recorded) return tight;
    for (const std::string& name : chains::tight_chains(part))
        for (const chains::Chain& chain : workload.workload.chains)
            if (chain.name == name) tight.push_back(name);
    return tight;
}

/// In the form of `bench smoke`, so that what reads one reads the other.
std::string sim_json(const BenchResults& results, const std::vector<SimRun>& runs, double wall_s,
                     const std::vector<Least>& least) {
    auto root = nlohmann::ordered_json::parse(to_json(results));
    root["program"] = "urgengo sim";
    root["simulated"] = "virtual";
    root["wall_s"] = wall_s;
    add_gates(root["runs"], runs);
    for (const Least& one : least)
        root["least"].push_back({{"f_a", one.f_a},
                                 {"seed", one.seed},
                                 {"one_at_a_time_pct", 100 * one.misses.one_at_a_time},
                                 {"shared_pct", 100 * one.misses.shared}});
    return root.dump(1) + "\n";
}

}  // namespace

int cmd_sim(const SimOptions& given, const std::vector<std::string>& arguments) {
    SimOptions options = given;
    auto workload = read_sim_workload(options.workload, options.profile);
    if (!workload) return fail(kExitUsage, workload.error());
    std::optional<Measured> measured;
    if (!options.compare.empty()) {
        auto read = read_measured(options.compare, {workload->names(), options.bystander_matmul});
        if (!read) return fail(kExitUsage, read.error());
        measured = std::move(*read);
        follow(*measured, options);
        workload->times = measured->times;
    }
    complete(options);
    const std::string wrong = check(options);
    if (!wrong.empty()) return fail(kExitUsage, wrong);
    const Simulation simulation{options, *workload, tight_of(*workload, options.f_tight)};
    try {
        if (!options.out.empty()) chains::check_writable(options.out);
    } catch (const std::runtime_error& error) {
        return fail(kExitUsage, error.what());
    }
    if (options.least && simulation.workload.workload.variable)
        return fail(kExitUsage,
                    "--least: found a workload whose input sizes vary, accepted: sizes that stay");
    const auto begin = std::chrono::steady_clock::now();
    const Interrupts interrupts;
    const auto runs = run_all(simulation);
    if (!runs) return fail(Interrupts::has_come() ? kExitInterrupted : kExitFailure, runs.error());
    const double wall_s =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    std::vector<std::string> command{"urgengo"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    BenchResults results{
        true,
        fmt::format("{}, in virtual time", simulation.workload.workload.gpu),
        kVersion,
        kCommit,
        utc_now(),
        command_line_for_results(command),
        {{"f_a", fmt::format("{}", fmt::join(options.f_a, " "))},
         {"f_d", fmt::format("{}", options.f_d)},
         {"rows", fmt::format("{}", fmt::join(options.rows, ","))},
         {"seconds", fmt::format("{}", options.seconds)},
         {"seeds", fmt::format("{}", fmt::join(options.seeds, " "))},
         {"cores", std::to_string(options.cores)},
         {"bystander_ms", fmt::format("{}", options.bystander_ms)},
         {"bystander_every_ms", fmt::format("{}", options.bystander_every_ms)},
         {"bystander_matmul", options.bystander_matmul ? "yes" : "no"},
         {"parking_every_ms", fmt::format("{}", options.parking_every_ms)},
         {"launch_capacity", fmt::format("{}", options.launch_capacity)},
         {"stall_ms", fmt::format("{}", options.stall_ms)},
         {"stall_every_ms", fmt::format("{}", options.stall_every_ms)},
         {"warmup", fmt::format("{}", options.warmup)},
         {"mark_late_us", fmt::format("{}", options.mark_late_us)},
         {"workload", options.workload.empty() ? "H200, ten chains" : "given"}},
        config::to_hex(fnv1a64(chains::format_workload(simulation.workload.workload))),
        options.rows,
        options.f_a,
        {},
        results_of(*runs)};
    sort_rows(results);
    fmt::print("{}, {} s a run, seeds {}\n\n{}", results.gpu_line, options.seconds,
               fmt::join(options.seeds, ", "),
               format_table(results, results.rows.size() <= kRowsWithChains));
    if (measured) fmt::print("\n{}", format_comparison(compare(results, *measured), *measured));
    fmt::print("{}", format_gates(*runs, options.seconds));
    const std::vector<Least> least = options.least ? find_least(simulation) : std::vector<Least>{};
    if (options.least) fmt::print("\n{}", format_least(least));
    return write_report(options.out, sim_json(results, *runs, wall_s, least)) ? 0 : kExitFailure;
}

}  // namespace urgengo::cli
