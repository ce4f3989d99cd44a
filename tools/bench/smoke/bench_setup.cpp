// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/bench_setup.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cstdio>
#include <filesystem>

#include "host/base/atomic_file.h"
#include "tools/bench/smoke/level_yaml.h"
#include "tools/log/log.h"
#include "tools/urgengo/doctor/gpu_probe.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/paths.h"
#include "tools/urgengo/program/environment_check.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;

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
        // The user may have put the simulated GPU on the loader's path.
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

/// Asked before minutes of measuring and not after. @returns what is wrong; empty if nothing is
std::string wrong_output(const BenchOptions& options) {
    for (const std::string& path : {options.out, options.html}) {
        const std::string reason = path.empty() ? "" : why_not_writable(path);
        if (!reason.empty()) return path + ": cannot be written: " + reason;
    }
    return {};
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

bool all_bare(const BenchOptions& options) {
    for (const std::string& row : options.rows) {
        if (!parse_row(row).preset.empty()) return false;
    }
    return true;
}

}  // namespace

void add_bench_options(CLI::App& command, BenchOptions& options) {
    command.add_option("--f-d", options.f_d, "Factor on deadlines")
        ->check(CLI::Range(0.01, 100.0))
        ->capture_default_str();
    command.add_option("--f-a", options.f_a, "Factors on arrival rates")
        ->delimiter(',')
        ->check(CLI::Range(0.01, 100.0))
        ->capture_default_str();
    command.add_option("--seconds", options.seconds, "Length of a run")
        ->check(CLI::Range(0.1, 86400.0))
        ->capture_default_str();
    command.add_option("--repeats", options.repeats, "Runs of each kind, seed, seed + 1, ...")
        ->check(CLI::Range(1, 1000))
        ->capture_default_str();
    command.add_option("--seed", options.seed, "Seed of the arrivals")->capture_default_str();
    CLI::Option* workload =
        command
            .add_option("--workload", options.workload, "A calibrated workload, to be used again")
            ->check(CLI::ExistingFile);
    command.add_flag("--variable", options.variable,
                     "Inputs vary in size from frame to frame, in the paper's ranges");
    command
        .add_option("--profile-seconds", options.profile_seconds,
                    "Learn the profile for so long [until every chain has had 5 frames]")
        ->check(CLI::Range(0.1, 86400.0));
    command.add_flag("--profile-isolated", options.profile_isolated,
                     "Learn the profile with one task's GPU work at a time");
    command.add_option("--out", options.out, "Write conditions and results as JSON");
    command.add_option("--simgpu", options.simgpu, "Use the simulated GPU: auto, yes, no")
        ->check(CLI::IsMember({"auto", "yes", "no"}))
        ->capture_default_str();
    command.add_option("--umin", options.umin, "Calibration: least utilisation of a kernel")
        ->excludes(workload);
    command.add_option("--umax", options.umax, "Calibration: greatest utilisation of a kernel")
        ->excludes(workload);
    command.add_option("--cpu", options.cpu, "CPU segments: spin, sleep, auto");
    command.add_option("--sync", options.sync, "Synchronisation waits: spin, block");
    command.add_option("--queue", options.queue, "Frames that wait: all, latest");
}

bool prepare_bench(const BenchOptions& options, BenchSetup& setup, BenchObstacle& obstacle) {
    const auto stop = [&obstacle](int exit_code, const std::string& message) {
        obstacle = {exit_code, message};
        return false;
    };
    for (const std::string& wrong : {check(options), wrong_output(options)}) {
        if (!wrong.empty()) return stop(kExitUsage, wrong);
    }
    const auto chains = chains_program();
    const auto yaml = chains_config("chains.yaml");
    const auto yaml_nohints = chains_config("chains_nohints.yaml");
    for (const auto* part : {&chains, &yaml, &yaml_nohints}) {
        if (!*part) return stop(kExitUsage, part->error());
    }
    const auto longest = longest_period(*yaml);
    if (!longest) return stop(kExitUsage, longest.error());
    const auto interposer = interposer_library();
    if (!interposer && !all_bare(options)) return stop(kExitUsage, interposer.error());

    const Environment own = current_environment();
    auto gpu = choose_gpu(options.simgpu, value_of(own, "URGENGO_REAL_LIBCUDA"));
    if (!gpu) return stop(kExitFailure, gpu.error());
    fmt::print("{}\n", gpu->line);
    std::fflush(stdout);
    auto folder = TemporaryFolder::make();
    if (!folder) return stop(kExitFailure, folder.error());

    BenchPaths paths{urgengo_program(), *chains,          *yaml, *yaml_nohints, options.workload,
                     (*folder)->path(), gpu->real_libcuda};
    if (paths.workload.empty()) paths.workload = paths.folder + "/workload.json";
    setup.plan = make_plan(options, paths, default_profile_seconds(*longest));
    setup.environment = child_environment(own, interposer ? *interposer : "", *gpu);
    setup.gpu = std::move(*gpu);
    setup.folder = std::move(*folder);
    return true;
}

std::vector<std::pair<std::string, std::string>> list_parameters(const BenchOptions& options) {
    const auto or_default = [](const std::string& text) { return text.empty() ? "default" : text; };
    const auto number = [](std::optional<double> value) {
        return value ? fmt::format("{}", *value) : "default";
    };
    return {{"f_a", fmt::format("{}", fmt::join(options.f_a, " "))},
            {"f_d", fmt::format("{}", options.f_d)},
            {"rows", fmt::format("{}", fmt::join(options.rows, ","))},
            {"seconds", fmt::format("{}", options.seconds)},
            {"repeats", std::to_string(options.repeats)},
            {"seed", std::to_string(options.seed)},
            {"workload", options.workload.empty() ? "calibrated" : "given"},
            {"variable", options.variable ? "true" : "as the workload"},
            {"frees", fmt::format("{}", options.frees)},
            {"umin", number(options.umin)},
            {"umax", number(options.umax)},
            {"eval_interval_us",
             options.eval_interval_us ? std::to_string(*options.eval_interval_us) : "default"},
            {"threads", or_default(options.threads)},
            {"cpu", or_default(options.cpu)},
            {"sync", or_default(options.sync)},
            {"queue", or_default(options.queue)}};
}

bool write_report(const std::string& path, const std::string& text) {
    if (path.empty()) return true;
    const auto written = write_file_atomically(path, text);
    if (written)
        tools::log_info("wrote {}", path);
    else
        tools::log_error("{}", written.error());
    return static_cast<bool>(written);
}

}  // namespace urgengo::cli
