// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/cmd_bench_smoke.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <system_error>

#include "host/base/atomic_file.h"
#include "tools/results.h"
#include "tools/urgengo/bench_json.h"
#include "tools/urgengo/bench_runner.h"
#include "tools/urgengo/bench_table.h"
#include "tools/urgengo/environment.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/gpu_probe.h"
#include "tools/urgengo/html_report.h"
#include "tools/urgengo/paths.h"
#include "tools/urgengo/run_process.h"
#include "tools/urgengo/temporary_folder.h"
#include "urgengo_build_info.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;

struct ChosenGpu {
    bool simulated = false;
    std::string line;          ///< what to say about it
    std::string real_libcuda;  ///< for `urgengo run`; empty: it searches
};

Result<ChosenGpu> simulated_gpu(const std::string& why) {
    const auto library = simulated_gpu_library();
    if (!library) return Error{library.error()};
    return ChosenGpu{true, "SIMULATED GPU (" + why + ")", *library};
}

/// @param real_libcuda  the user's URGENGO_REAL_LIBCUDA, may be empty
Result<ChosenGpu> choose_gpu(const std::string& simgpu, const std::string& real_libcuda) {
    if (simgpu == "yes") return simulated_gpu("as asked");
    const GpuProbe probe = probe_gpu(real_libcuda);
    if (probe.found) {
        // Somebody may have put the simulated GPU on the loader's path himself.
        const bool simulated = probe.name.find("Simulated") != std::string::npos;
        return ChosenGpu{simulated, (simulated ? "SIMULATED GPU: " : "GPU: ") + probe.name,
                         real_libcuda};
    }
    if (simgpu == "no") return Error{"no GPU: " + probe.problem};
    return simulated_gpu("no GPU: " + probe.problem);
}

std::string value_of(const Environment& environment, const char* name) {
    const auto entry = environment.find(name);
    return entry == environment.end() ? "" : entry->second;
}

std::vector<std::pair<std::string, std::string>> list_parameters(const BenchOptions& options) {
    const auto or_default = [](const std::string& text) { return text.empty() ? "default" : text; };
    const auto number = [](std::optional<double> value) {
        return value ? fmt::format("{}", *value) : "default";
    };
    return {{"f_a", fmt::format("{}", fmt::join(options.f_a, " "))},
            {"f_d", "1"},
            {"rows", fmt::format("{}", fmt::join(options.rows, ","))},
            {"seconds", fmt::format("{}", options.seconds)},
            {"repeats", std::to_string(options.repeats)},
            {"seed", std::to_string(options.seed)},
            {"workload", options.workload.empty() ? "calibrated" : options.workload},
            {"umin", number(options.umin)},
            {"umax", number(options.umax)},
            {"threads", or_default(options.threads)},
            {"cpu", or_default(options.cpu)},
            {"sync", or_default(options.sync)},
            {"queue", or_default(options.queue)}};
}

/// Asked before minutes of measuring and not after. @returns what is wrong; empty if nothing is
std::string why_not_writable(const std::string& path) {
    if (path.empty()) return {};
    const std::string folder = fs::absolute(path).parent_path().string();
    if (access(folder.c_str(), W_OK) == 0) return {};
    return path + ": cannot be written: " + std::generic_category().message(errno);
}

/// @param path  empty: not asked for
/// @returns whether nothing went wrong
bool write_report(const std::string& path, const std::string& text) {
    if (path.empty()) return true;
    const auto written = write_file_atomically(path, text);
    fmt::print(stderr, "urgengo: {}\n", written ? "wrote " + path : written.error());
    return static_cast<bool>(written);
}

/// The children's environment: no trace of UrgenGo, which `urgengo run` adds to the rows that want
/// it.
Environment child_environment(const Environment& own, const std::string& interposer,
                              const ChosenGpu& gpu) {
    Environment environment = bare_environment(own, interposer);
    if (gpu.simulated && !gpu.real_libcuda.empty()) {
        prepend_library_folder(environment, fs::path(gpu.real_libcuda).parent_path().string());
    }
    return environment;
}

}  // namespace

CLI::App* add_bench_smoke(CLI::App& bench, BenchOptions& options) {
    CLI::App* command = bench.add_subcommand(
        "smoke", "The ten-chain workload at a few loads, in about two minutes");
    command->add_option("--f-a", options.f_a, "Factors on arrival rates [0.7 0.9 1.1]")
        ->delimiter(',')
        ->check(CLI::Range(0.01, 100.0));
    command->add_option("--seconds", options.seconds, "Length of a run [12]")
        ->check(CLI::Range(0.1, 86400.0));
    command->add_option("--repeats", options.repeats, "Runs of each kind, seed, seed + 1, ... [1]")
        ->check(CLI::Range(1, 1000));
    command->add_option("--seed", options.seed, "Seed of the arrivals [1]");
    command->add_option("--rows", options.rows, "What to compare [bare,vanilla,urgengo]")
        ->delimiter(',');
    CLI::Option* workload =
        command
            ->add_option("--workload", options.workload, "A calibrated workload, to be used again")
            ->check(CLI::ExistingFile);
    command->add_option("--out", options.out, "Write conditions and every run as JSON");
    command->add_option("--html", options.html, "Write a report to look at");
    command->add_option("--simgpu", options.simgpu, "Use the simulated GPU: auto, yes, no [auto]")
        ->check(CLI::IsMember({"auto", "yes", "no"}));
    command->add_option("--umin", options.umin, "Calibration: least utilisation of a kernel")
        ->excludes(workload);
    command->add_option("--umax", options.umax, "Calibration: greatest utilisation of a kernel")
        ->excludes(workload);
    command->add_option("--threads", options.threads, "One thread for each: chain, task");
    command->add_option("--cpu", options.cpu, "CPU segments: spin, sleep, auto");
    command->add_option("--sync", options.sync, "Synchronisation waits: spin, block");
    command->add_option("--queue", options.queue, "Frames that wait: all, latest");
    return command;
}

int cmd_bench_smoke(const BenchOptions& options, const std::vector<std::string>& arguments) {
    for (const std::string& wrong :
         {check(options), why_not_writable(options.out), why_not_writable(options.html)}) {
        if (!wrong.empty()) return fail(kExitUsage, wrong);
    }
    const auto chains = chains_program();
    if (!chains) return fail(kExitUsage, chains.error());
    const auto interposer = interposer_library();
    const bool only_bare = options.rows == std::vector<std::string>{kBareRow};
    if (!interposer && !only_bare) return fail(kExitUsage, interposer.error());

    const Environment own = current_environment();
    const auto gpu = choose_gpu(options.simgpu, value_of(own, "URGENGO_REAL_LIBCUDA"));
    if (!gpu) return fail(kExitFailure, gpu.error());
    fmt::print("{}\n", gpu->line);
    std::fflush(stdout);

    const auto folder = TemporaryFolder::make();
    if (!folder) return fail(kExitFailure, folder.error());
    BenchPaths paths{own_program(), *chains, options.workload, (*folder)->path(),
                     gpu->real_libcuda};
    if (paths.workload.empty()) paths.workload = paths.folder + "/workload.json";
    const auto outcome = carry_out(make_plan(options, paths),
                                   child_environment(own, interposer ? *interposer : "", *gpu));
    if (!outcome) return fail(kExitFailure, outcome.error());
    if (outcome->interrupted) return fail(kExitInterrupted, "interrupted");

    Arguments command{"urgengo"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    const BenchResults results{gpu->simulated,
                               gpu->line,
                               kVersion,
                               kCommit,
                               utc_now(),
                               command_line_for_results(command),
                               list_parameters(options),
                               options.rows,
                               options.f_a,
                               outcome->runs};
    fmt::print("{} s a run, {} {}, seed {}, {}\n\n{}", options.seconds, options.repeats,
               options.repeats == 1 ? "run each" : "runs each: median (min..max)", options.seed,
               "miss % is the mean of the chains' miss ratios", format_table(results));
    const bool json_written = write_report(options.out, to_json(results));
    const bool html_written = write_report(options.html, html_report(results));
    return json_written && html_written ? 0 : kExitFailure;
}

}  // namespace urgengo::cli
