// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/commands/cmd_bench_calls.h"

#include <fmt/format.h>

#include <filesystem>
#include <fstream>

#include "host/config/file_text.h"
#include "tools/bench/bench_config.h"
#include "tools/bench/measure/bench_calls.h"
#include "tools/bench/smoke/bench_program.h"
#include "tools/log/log.h"
#include "tools/results.h"
#include "tools/urgengo/environment.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/paths.h"
#include "tools/urgengo/program/run_process.h"
#include "tools/urgengo/progress_bar.h"
#include "tools/urgengo/temporary_folder.h"
#include "urgengo_build_info.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;

constexpr char kEverything[] = ".";
constexpr char kUnscheduled[] = "^(pass_through|nothing_to_do|pair)/";
constexpr char kScheduled[] = "^scheduled/";

struct CallPaths {
    std::string program, interposer, driver, nvtx_tool, folder;
};

std::vector<CallCondition> make_conditions(const BenchCallsOptions& options) {
    std::vector<CallCondition> conditions{{"bare", kEverything},
                                          {"no config", kUnscheduled},
                                          {"armed, of no chain", kUnscheduled, 10}};
    for (const int chains : options.chains)
        conditions.push_back(
            {fmt::format("{} chain{}", chains, chains == 1 ? "" : "s"), kScheduled, chains});
    // Marks apart: none within a frame, and one behind every launch, which needs another chain that
    // looks.
    conditions.push_back({"1 chain, no marks", kScheduled, 1, 10'000});
    const CallCondition marked{"2 chains, mark every launch", kScheduled, 2, 0};
    conditions.push_back(marked);
    // Each mark that is seen is a record.
    for (const auto& [what, records] :
         {std::pair{"no records", CallRecords::kNone}, std::pair{"trace", CallRecords::kTrace}}) {
        CallCondition& recorded = conditions.emplace_back(marked);
        recorded.name += std::string(", ") + what;
        recorded.records = records;
    }
    // With an NVTX tool: launches of which there is nothing to tell, as most are, and with marks.
    for (const CallCondition& told : {CallCondition{"10 chains", kScheduled, 10}, marked}) {
        CallCondition& with_tool = conditions.emplace_back(told);
        with_tool.name += ", NVTX tool";
        with_tool.nvtx = true;
    }
    return conditions;
}

std::string first_cpu_name() {
    std::ifstream file("/proc/cpuinfo");
    for (std::string line; std::getline(file, line);)
        if (line.starts_with("model name")) return line.substr(line.find(": ") + 2);
    return "unknown";
}

/// @returns the program's environment under this condition
Environment environment_for(const CallCondition& condition, const CallPaths& paths,
                            const std::string& config, const std::string& stats) {
    Environment environment = bare_environment(current_environment(), paths.interposer);
    prepend_library_folder(environment, fs::path(paths.driver).parent_path().string());
    if (condition.name == "bare") return environment;
    ScheduledProgram scheduled;
    scheduled.interposer = paths.interposer;
    scheduled.real_libcuda = paths.driver;
    scheduled.summary = false;
    if (condition.chains > 0) {
        scheduled.config = config;
        scheduled.stats = stats;
    }
    environment = scheduled_environment(std::move(environment), scheduled);
    if (condition.records == CallRecords::kNone) environment["URGENGO_FLIGHT_RECORDS"] = "0";
    if (condition.nvtx) environment["NVTX_INJECTION64_PATH"] = paths.nvtx_tool;
    if (condition.records == CallRecords::kTrace)
        environment["URGENGO_RUN_TRACE"] = paths.folder + "/run.ugtrace";
    return environment;
}

Result<CallTimes> run_once(const CallCondition& condition, const BenchCallsOptions& options,
                           const CallPaths& paths) {
    const std::string out = paths.folder + "/times.json", config = paths.folder + "/config.json",
                      stats = paths.folder + "/stats.json";
    const std::string chains = fmt::format("--chains={}", std::max(condition.chains, 1));
    if (condition.chains > 0) {
        std::vector<std::string> command{paths.program, "--write-config=" + config, chains,
                                         fmt::format("--kernel-us={}", condition.kernel_us)};
        if (condition.mark_every_us)
            command.push_back(fmt::format("--mark-every-us={}", *condition.mark_every_us));
        const auto written = run_to_end(command, environment_for({"bare", ""}, paths, "", ""));
        if (!written) return Error{written.error()};
    }
    const auto ran = run_to_end({paths.program, chains, "--benchmark_filter=" + condition.filter,
                                 fmt::format("--benchmark_min_time={}", options.min_seconds),
                                 "--benchmark_out_format=json", "--benchmark_out=" + out},
                                environment_for(condition, paths, config, stats));
    if (!ran) return Error{ran.error()};
    if (condition.filter == kScheduled) {
        const auto text = config::read_file(stats);
        const std::string wrong = text ? why_not_scheduled(*text, bench::kMeasured) : text.error();
        if (!wrong.empty()) return Error{condition.name + ": " + wrong};
    }
    const auto text = config::read_file(out);
    if (!text) return Error{text.error()};
    auto times = parse_call_times(*text, out);
    std::string wrong;
    if (times && condition.mark_every_us == 0) wrong = why_not_marked(*times);
    if (times && condition.nvtx && wrong.empty()) wrong = why_not_told(*times);
    if (!wrong.empty()) return Error{condition.name + ": " + wrong};
    return times;
}

/// @returns an exit code
int carry_out(CallBench& bench, const BenchCallsOptions& options, const CallPaths& paths) {
    bench.runs.resize(bench.conditions.size());
    const std::size_t num = bench.conditions.size();
    ProgressBar bar;
    // In turns, so that a machine that changes its pace changes it for all.
    for (int round = 1; round <= options.rounds; ++round) {
        for (std::size_t i = 0; i < bench.conditions.size(); ++i) {
            tools::log_info("[{}/{}] {}", round, options.rounds, bench.conditions[i].name);
            bar.show_step(static_cast<std::size_t>(round - 1) * num + i,
                          static_cast<std::size_t>(options.rounds) * num, bench.conditions[i].name);
            auto times = run_once(bench.conditions[i], options, paths);
            if (!times && times.error().empty()) return fail(kExitInterrupted, "interrupted");
            if (!times) return fail(kExitFailure, times.error());
            bench.runs[i].push_back(std::move(*times));
        }
    }
    return 0;
}

}  // namespace

CLI::App* add_bench_calls(CLI::App& bench, BenchCallsOptions& options) {
    CLI::App* command =
        bench.add_subcommand("calls", "What UrgenGo adds to a driver call; needs no GPU");
    command->add_option("--chains", options.chains, "Numbers of chains [1,10,40]")
        ->delimiter(',')
        ->check(CLI::Range(1, 63));
    command->add_option("--rounds", options.rounds, "Runs of each kind, in turns [5]")
        ->check(CLI::Range(1, 1000));
    command->add_option("--min-seconds", options.min_seconds, "At least, for each case [0.1]")
        ->check(CLI::Range(0.001, 60.0));
    command->add_option("--out", options.out, "Write every time as JSON");
    return command;
}

int cmd_bench_calls(const BenchCallsOptions& options, const std::vector<std::string>& arguments) {
    const auto program = call_bench_program();
    if (!program) return fail(kExitUsage, program.error());
    const auto interposer = interposer_library();
    if (!interposer) return fail(kExitUsage, interposer.error());
    const auto driver = null_driver_library();
    if (!driver) return fail(kExitUsage, driver.error());
    const auto nvtx_tool = null_nvtx_tool();
    if (!nvtx_tool) return fail(kExitUsage, nvtx_tool.error());
    const auto folder = TemporaryFolder::make();
    if (!folder) return fail(kExitFailure, folder.error());

    std::vector<std::string> command{"urgengo"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    CallBench bench;
    bench.conditions = make_conditions(options);
    bench.driver_name = "null driver: answers at once, no GPU";
    bench.cpu = first_cpu_name();
    bench.version = kVersion;
    bench.commit = kCommit;
    bench.date_utc = utc_now();
    bench.command_line = command_line_for_results(command);
    const int failed =
        carry_out(bench, options, {*program, *interposer, *driver, *nvtx_tool, (*folder)->path()});
    if (failed) return failed;

    fmt::print("{}, {}\n{} rounds: median (min..max); own = with UrgenGo less bare\n\n{}",
               bench.cpu, bench.driver_name, options.rounds, format_call_table(bench));
    return write_results(options.out, to_json(bench));
}

}  // namespace urgengo::cli
