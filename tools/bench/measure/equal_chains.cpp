// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/measure/equal_chains.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "host/base/atomic_file.h"
#include "host/config/config_reader.h"
#include "host/config/limits.h"
#include "host/config/profile_json.h"
#include "host/config/profile_reader.h"
#include "tools/bench/smoke/bench_program.h"
#include "tools/chains/copies.h"
#include "tools/log/log.h"
#include "tools/results.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/paths.h"
#include "tools/urgengo/program/run_process.h"
#include "tools/urgengo/progress_bar.h"
#include "urgengo_build_info.h"

namespace urgengo::cli {
namespace {

/// One copy has had ten frames then.
constexpr double kLearnSeconds = 2;

double to_ms(std::chrono::nanoseconds time) {
    return static_cast<double>(time.count()) / 1e6;
}

std::string name_of(int index) {
    return chains::copy_name(kEqualChain, static_cast<std::size_t>(index));
}

Result<config::Chain> find_chain() {
    const auto yaml = chains_config("chains.yaml");
    if (!yaml) return Error{yaml.error()};
    const auto config = config::read_config(*yaml);
    if (!config) return Error{config.error()};
    for (const config::Chain& chain : config->chains)
        if (chain.name == kEqualChain) return chain;
    return Error{*yaml + ": found no chain " + kEqualChain};
}

}  // namespace

void add_equal_chains_options(CLI::App& command, EqualChainsOptions& options) {
    command.add_option("--seconds", options.seconds, "Length of a run")
        ->check(CLI::Range(0.1, 86400.0))
        ->capture_default_str();
    command.add_option("--rounds", options.rounds, "Runs of each kind, seed, seed + 1, ...")
        ->check(CLI::Range(1, 1000))
        ->capture_default_str();
    command.add_option("--seed", options.seed, "Seed of the arrivals")->capture_default_str();
    command.add_option("--workload", options.workload, "A calibrated workload, to be used again")
        ->check(CLI::ExistingFile);
    command.add_option("--simgpu", options.simgpu, "Use the simulated GPU: auto, yes, no")
        ->check(CLI::IsMember({"auto", "yes", "no"}))
        ->capture_default_str();
    command.add_option("--cpu", options.cpu, "CPU segments: spin, sleep, auto")
        ->capture_default_str();
    command.add_option("--sync", options.sync, "Synchronisation waits: spin, block")
        ->capture_default_str();
    command
        .add_option("--queue", options.queue,
                    "Frames that wait: all (the run lasts until they are done), or the latest")
        ->capture_default_str();
    command.add_option("--out", options.out, "Write conditions and every run as JSON");
}

nlohmann::ordered_json parameters_json(const EqualChainsOptions& options) {
    return {{"chain", kEqualChain},
            {"merge_tasks", options.merge_tasks},
            {"deadline_periods", kDeadlinePeriods},
            {"seconds", options.seconds},
            {"rounds", options.rounds},
            {"seed", options.seed},
            {"workload", options.workload.empty() ? "calibrated" : "given"},
            {"cpu", options.cpu},
            {"sync", options.sync},
            {"queue", options.queue}};
}

std::string equal_chains_yaml(const config::Chain& chain, int num_chains, double f_a,
                              bool merge_tasks) {
    const double period_ms = to_ms(chain.period) / f_a;
    std::string yaml = "version: 1\nmode: enforce\nchains:\n";
    for (int i = 0; i < num_chains; ++i) {
        const std::string name = name_of(i);
        yaml += fmt::format(
            "  - name: {}\n    period_ms: {:.6f}\n    deadline_ms: {:.6f}\n"
            "    arrival: {{from: hint}}\n    tasks:\n",
            name, period_ms, std::min(period_ms * kDeadlinePeriods, config::kMaxTimeMs));
        const std::size_t num_tasks = merge_tasks ? 1 : chain.tasks.size();
        for (std::size_t task = 0; task < num_tasks; ++task) {
            yaml += fmt::format("      - {{name: {}, thread: \"{}*\"}}\n", chain.tasks[task].name,
                                name);
        }
    }
    return yaml;
}

config::Profile profile_of_copies(config::Profile learned, int num_chains) {
    const config::ChainProfile one = learned.chains.front();
    learned.chains.clear();
    for (int i = 0; i < num_chains; ++i) {
        learned.chains.push_back(one);
        learned.chains.back().name = name_of(i);
    }
    return learned;
}

bool EqualChains::prepare(const EqualChainsOptions& options, BenchObstacle& obstacle) {
    options_ = options;
    BenchOptions bench;
    bench.rows = {"urgengo"};
    bench.f_a = {1};
    bench.workload = options.workload;
    bench.simgpu = options.simgpu;
    bench.out = options.out;
    if (!prepare_bench(bench, setup_, obstacle)) return false;
    const auto chain = find_chain();
    const auto program = chains_program();
    if (!chain || !program) {
        obstacle = {kExitUsage, !chain ? chain.error() : program.error()};
        return false;
    }
    chain_ = *chain;
    program_ = *program;
    // For all rows: what rows differ by is UrgenGo, not the number of hardware queues.
    setup_.environment.try_emplace("CUDA_DEVICE_MAX_CONNECTIONS",
                                   std::to_string(config::kConnections.max));
    scheduled_ = setup_.environment;
    scheduled_.insert(setup_.plan.scheduled.begin(), setup_.plan.scheduled.end());
    return true;
}

std::vector<std::string> EqualChains::program(int num_chains, double f_a, double seconds,
                                              std::uint32_t seed) const {
    std::vector<std::string> arguments{program_,     "run",
                                       "--workload", setup_.plan.workload,
                                       "--only",     kEqualChain,
                                       "--copies",   std::to_string(num_chains),
                                       "--f-a",      fmt::format("{}", f_a),
                                       "--seconds",  fmt::format("{}", seconds),
                                       "--seed",     std::to_string(seed),
                                       "--cpu",      options_.cpu,
                                       "--sync",     options_.sync,
                                       "--queue",    options_.queue,
                                       "--quiet",    "--no-deadlines"};
    if (options_.merge_tasks) arguments.push_back("--merge-tasks");
    return arguments;
}

Result<bool> EqualChains::write_config(int num_chains, double f_a) {
    return write_file_atomically(file("chains.yaml"),
                                 equal_chains_yaml(chain_, num_chains, f_a, options_.merge_tasks));
}

Result<bool> EqualChains::learn() {
    ProgressBar bar;
    if (!setup_.plan.calibrate.empty()) {
        tools::log_info("calibrating the workload");
        bar.show(-1, "calibrating the workload");
        const auto ran = run_to_end(setup_.plan.calibrate, setup_.environment);
        if (!ran) return ran;
    }
    tools::log_info("learning a profile");
    bar.show(-1, "learning a profile");
    const auto written = write_config(1, 1);
    if (!written) return written;
    std::vector<std::string> arguments{urgengo_program(),
                                       "profile",
                                       "-c",
                                       file("chains.yaml"),
                                       "--in-situ",
                                       "-o",
                                       file("learned.profile.json"),
                                       "--"};
    // Arrivals that no run has.
    const auto of_program =
        program(1, 1, kLearnSeconds, options_.seed + static_cast<std::uint32_t>(options_.rounds));
    arguments.insert(arguments.end(), of_program.begin(), of_program.end());
    const auto ran = run_to_end(arguments, scheduled_);
    if (!ran) return ran;
    auto learned = config::read_profile(file("learned.profile.json"));
    if (!learned) return Error{learned.error()};
    if (learned->chains.empty() || learned->chains.front().tasks.empty() ||
        learned->chains.front().tasks.front().kernels.empty())
        return Error{"the profile knows no kernel of " + std::string(kEqualChain)};
    learned_ = std::move(*learned);
    return true;
}

Result<EqualChainsResult> EqualChains::run(const EqualChainsRun& run) {
    const bool bare = run.row == kBareRow;
    const std::string stats = file("stats.json"), own_time = stats + ".own_time.json";
    std::vector<std::string> arguments;
    if (!bare) {
        const auto written = write_config(run.num_chains, run.f_a);
        if (!written) return Error{written.error()};
        const auto profiled =
            write_file_atomically(file("copies.profile.json"),
                                  to_profile_text(profile_of_copies(learned_, run.num_chains)));
        if (!profiled) return Error{profiled.error()};
        arguments = {urgengo_program(),
                     "run",
                     "-c",
                     file("chains.yaml"),
                     "--profile",
                     file("copies.profile.json"),
                     "--preset",
                     run.row,
                     "--stats",
                     stats,
                     "--quiet"};
        if (!options_.interposer.empty())
            arguments.insert(arguments.end(), {"--interposer", options_.interposer});
        arguments.push_back("--");
    }
    const auto of_program = program(run.num_chains, run.f_a, options_.seconds, run.seed);
    arguments.insert(arguments.end(), of_program.begin(), of_program.end());
    arguments.insert(arguments.end(), {"--json", file("run.json")});
    for (const std::string& old : {stats, own_time}) std::filesystem::remove(old);
    const auto ran = run_to_end(arguments, bare ? setup_.environment : scheduled_);
    if (!ran) return Error{ran.error()};

    EqualChainsResult result;
    auto report = read_json(file("run.json"));
    if (!report) return Error{report.error()};
    result.report = std::move(*report);
    const auto saw = result.report.at("urgengo").get<std::string>();
    const std::string must_see = bare ? "not loaded" : "scheduling";
    if (saw != must_see)
        return Error{
            fmt::format("{}: the program saw UrgenGo {}, accepted: {}", run.row, saw, must_see)};
    if (bare) return result;
    auto statistics = read_json(stats);
    if (!statistics) return Error{statistics.error()};
    result.stats = std::move(*statistics);
    if (auto own = read_json(own_time)) result.own_time = std::move(*own);
    return result;
}

nlohmann::ordered_json record_of(const std::string& program, const EqualChains& chains,
                                 const EqualChainsOptions& options,
                                 const nlohmann::ordered_json& report,
                                 const std::vector<std::string>& arguments) {
    std::vector<std::string> command{"urgengo"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    return {{"format_version", 1},
            {"program", program},
            {"gpu", report.at("gpu")},
            {"simulated_gpu", chains.gpu().simulated},
            {"driver", report.at("kernel_driver_version")},
            {"version", kVersion},
            {"commit", kCommit},
            {"date_utc", utc_now()},
            {"command_line", command_line_for_results(command)},
            {"parameters", parameters_json(options)}};
}

}  // namespace urgengo::cli
