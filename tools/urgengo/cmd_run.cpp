// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/cmd_run.h"

#include <chrono>
#include <filesystem>
#include <optional>

#include "host/config/connections.h"
#include "host/config/names.h"
#include "host/config/presets.h"
#include "tools/log/log.h"
#include "tools/urgengo/doctor/gpu_probe.h"
#include "tools/urgengo/doctor/priority_probe.h"
#include "tools/urgengo/environment.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/paths.h"
#include "tools/urgengo/program/environment_check.h"
#include "tools/urgengo/program/program_setup.h"
#include "tools/urgengo/program/pruned_library.h"
#include "tools/urgengo/resolve.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;

/// @returns what is wrong with the options; empty if nothing is
std::string check(const RunOptions& options) {
    if (options.observe && !options.mode.empty() && options.mode != "observe") {
        return "--observe and --mode " + options.mode + ", accepted: one of them";
    }
    if (!options.mode.empty() && !config::from_word<config::Mode>(options.mode)) {
        return "--mode: found '" + options.mode +
               "', accepted: " + config::all_words<config::Mode>();
    }
    if (!options.preset.empty() && !config::preset(options.preset)) {
        return "--preset: found '" + options.preset + "', accepted: " + config::preset_names();
    }
    if (options.config.empty() && !fs::exists(kDefaultConfig)) {
        return "no config: accepted: -c FILE, or a chains.yaml in the current folder";
    }
    if (!options.real_libcuda.empty() && !fs::exists(options.real_libcuda)) {
        return "--real-libcuda: found '" + options.real_libcuda +
               "', accepted: the path of a libcuda.so.1";
    }
    return {};
}

/// The mode that the program will run in: asked for here, else in the environment, else configured.
config::Mode effective_mode(const std::string& asked, const Environment& environment,
                            config::Mode configured) {
    if (const auto mode = config::from_word<config::Mode>(asked)) return *mode;
    return config::from_word<config::Mode>(value_of(environment, "URGENGO_MODE"))
        .value_or(configured);
}

/// The GPU that the program will find: asked for when first needed, and once.
class TargetGpu {
  public:
    explicit TargetGpu(std::string library) : library_(std::move(library)) {}
    const GpuProbe& get() {
        if (!probe_) probe_ = probe_gpu(library_);
        return *probe_;
    }

  private:
    std::string library_;
    std::optional<GpuProbe> probe_;
};

/// What a profile must have been learned on. A machine without a GPU says nothing against it.
config::RunTarget run_target(const ProgramSetup& setup, const GpuProbe& gpu,
                             std::vector<std::string>& warnings) {
    if (!gpu.found)
        warnings.push_back("found no GPU, accepted: one that the driver can use (" + gpu.problem +
                           "); the program will find none either");
    return {gpu.name, gpu.driver, gpu.sm_clock_mhz, gpu.memory_clock_mhz, setup.name};
}

/// What `priority_via: auto` stands for. Whatever goes wrong here, the program is started.
config::PriorityVia find_priority_via(const RunOptions& options, const Environment& environment,
                                      const std::string& driver, const GpuProbe& gpu) {
    if (!gpu.found) return config::PriorityVia::kLaunchAttribute;
    const PriorityKey key = priority_key(gpu.name, gpu.driver, driver);
    const PriorityCache cache(cache_folder(environment));
    Result<PriorityMeasurement> measured = cache.find(key);
    const bool is_new = !measured;
    std::string not_stored;
    if (is_new) {
        measured = probe_priority(driver, kPriorityLimit);
        if (measured) {
            const auto stored = cache.store(key, *measured);
            if (!stored) not_stored = "; not remembered: " + stored.error();
        }
    }
    const PriorityChoice choice = choose_priority(measured);
    if (is_new && options.verbose) {
        tools::log_info("priority_via: auto is {} on {}: {}{}", config::to_word(choice.via),
                        gpu.name, choice.reason, not_stored);
    }
    return choice.via;
}

bool uses_nvtx(const config::Config& config) {
    for (const config::Chain& chain : config.chains) {
        for (const config::Task& task : chain.tasks) {
            if (!task.nvtx_glob.empty()) return true;
        }
    }
    return false;
}

}  // namespace

CLI::App* add_run(CLI::App& app, RunOptions& options) {
    CLI::App* command = app.add_subcommand("run", "Run a program with its launches scheduled");
    command->footer("After the options: -- program [args...]");
    command->add_option("-c,--config", options.config, "The chains [chains.yaml]");
    command->add_option("--profile", options.profile,
                        "Kernels and times [<config's stem>.profile.json, if it exists]");
    command->add_flag("--allow-stale", options.allow_stale,
                      "Use a profile of another GPU or program all the same");
    command->add_option("--mode", options.mode, "off, observe, shadow or enforce [as configured]");
    command->add_flag("--observe", options.observe, "Count frames and misses, change nothing");
    command->add_option("--preset", options.preset,
                        "Preset instead of the config's; what the config writes besides stays: " +
                            config::preset_names());
    command->add_option(
        "--stats", options.stats,
        "Write every chain's statistics (JSON) at exit; %p stands for the process id");
    command->add_option(
        "--trace", options.trace,
        "Write what happens to this file, for `urgengo trace`; %p stands for the process id");
    command->add_flag("--no-probe", options.no_probe,
                      "Do not measure which priorities the GPU honours: priority_via: auto is "
                      "launch_attribute");
    command->add_flag("-v,--verbose", options.verbose,
                      "Say on stderr what was measured, if it was");
    command->add_flag("-q,--quiet", options.quiet, "No summary on stderr at exit, no warnings");
    command->add_option("--real-libcuda", options.real_libcuda,
                        "The driver's library, instead of searching for it");
    command
        ->add_option("--interposer", options.interposer,
                     "Another build of the library that programs load (one that measures itself, "
                     "say), instead of the one beside this program")
        ->check(CLI::ExistingFile);
    return command;
}

int cmd_run(const RunOptions& options, const std::vector<std::string>& program) {
    const std::string wrong = check(options);
    if (!wrong.empty()) return fail(kExitUsage, wrong);

    const Environment environment = current_environment();
    ProgramSetup setup =
        set_up_program(program, options.real_libcuda, environment, options.interposer);
    if (setup.exit_code != 0) return fail(setup.exit_code, setup.message);

    const std::string yaml = options.config.empty() ? kDefaultConfig : options.config;
    TargetGpu gpu(setup.driver.empty() ? setup.real_libcuda : setup.driver);
    // Only scheduling gives priorities.
    const auto priority_via = [&](const config::Config& config) {
        const std::string asked = options.observe ? "observe" : options.mode;
        const bool schedules =
            effective_mode(asked, environment, config.mode) == config::Mode::kEnforce &&
            config.scheduler.binding != config::Binding::kNone;
        if (!schedules) return config::PriorityVia::kAuto;
        if (options.no_probe) return config::PriorityVia::kLaunchAttribute;
        return find_priority_via(options, environment, setup.driver, gpu.get());
    };
    const auto resolved =
        resolve({yaml, options.profile, options.preset, options.allow_stale,
                 [&] { return run_target(setup, gpu.get(), setup.warnings); }, priority_via});
    if (!resolved) return fail(kExitUsage, resolved.error());

    ScheduledProgram scheduled;
    scheduled.interposer = setup.interposer;
    scheduled.config = resolved->path;
    scheduled.mode = options.observe ? "observe" : options.mode;
    scheduled.stats = absolute(options.stats);
    scheduled.trace = absolute(options.trace);
    scheduled.real_libcuda = setup.real_libcuda;
    scheduled.summary = !options.quiet;
    scheduled.nvtx = uses_nvtx(resolved->config);
    // Only scheduling may change the program's timing.
    const auto mode = effective_mode(scheduled.mode, environment, resolved->config.mode);
    if (mode == config::Mode::kEnforce)
        scheduled.connections = config::connections_of(resolved->config);
    const Environment theirs = scheduled_environment(environment, scheduled);
    const EnvironmentCheck checked = check_environment(theirs);
    if (!checked.error.empty()) return fail(kExitUsage, checked.error);
    if (!options.quiet) {
        warn(setup.warnings);
        warn(checked.warnings);
        warn(resolved->warnings);
    }
    return become(setup, program, theirs);
}

}  // namespace urgengo::cli
