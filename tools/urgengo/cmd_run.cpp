// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/cmd_run.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <system_error>

#include "host/config/names.h"
#include "host/config/presets.h"
#include "interposer/driver_file.h"
#include "tools/urgengo/environment.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/paths.h"
#include "tools/urgengo/program_check.h"
#include "tools/urgengo/pruned_library.h"
#include "tools/urgengo/resolve.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;

constexpr char kDefaultConfig[] = "chains.yaml";

/// The program may change its folder before it opens the file.
std::string absolute(const std::string& path) {
    return path.empty() ? path : fs::absolute(path).lexically_normal().string();
}

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
        return "--real-libcuda: " + options.real_libcuda + ": no such file";
    }
    return {};
}

/// The mode that the program will run in: asked for here, else in the environment, else configured.
config::Mode effective_mode(const std::string& asked, const Environment& environment,
                            config::Mode configured) {
    if (const auto mode = config::from_word<config::Mode>(asked)) return *mode;
    const auto variable = environment.find("URGENGO_MODE");
    if (variable == environment.end()) return configured;
    return config::from_word<config::Mode>(variable->second).value_or(configured);
}

std::string value_of(const Environment& environment, const char* name) {
    const auto found = environment.find(name);
    return found == environment.end() ? "" : found->second;
}

/// The library to preload, with no name that the driver lacks, if that can be had.
std::string library_for(const std::string& interposer, const std::string& real_libcuda,
                        const Environment& environment) {
    const std::string search = value_of(environment, "LD_LIBRARY_PATH");
    const std::string driver = interposer::find_driver_file(
        real_libcuda.empty() ? value_of(environment, "URGENGO_REAL_LIBCUDA") : real_libcuda,
        search.empty() ? nullptr : search.c_str());
    const auto library =
        library_without_missing_names(interposer, driver, cache_folder(environment));
    if (library) return *library;
    fmt::print(stderr,
               "urgengo: warning: {}; a program that needs what this driver lacks will start, and "
               "fail later\n",
               library.error());
    return interposer;
}

bool uses_nvtx(const config::Config& config) {
    for (const config::Chain& chain : config.chains) {
        for (const config::Task& task : chain.tasks) {
            if (!task.nvtx_glob.empty()) return true;
        }
    }
    return false;
}

std::vector<char*> pointers(std::vector<std::string>& texts) {
    std::vector<char*> list;
    for (std::string& text : texts) list.push_back(text.data());
    list.push_back(nullptr);
    return list;
}

int become(const std::string& path, std::vector<std::string> arguments,
           const Environment& environment) {
    std::vector<std::string> lines = to_lines(environment);
    // execvpe and not execve: it hands a script without "#!" to the shell, as execvp does.
    execvpe(path.c_str(), pointers(arguments).data(), pointers(lines).data());
    const int error = errno;
    return fail(error == ENOENT ? kExitNotFound : kExitNotExecutable,
                path + ": cannot be started: " + std::generic_category().message(error));
}

}  // namespace

CLI::App* add_run(CLI::App& app, RunOptions& options) {
    CLI::App* command = app.add_subcommand("run", "Run a program with its launches scheduled");
    command->footer("After the options: -- program [args...]");
    command->add_option("-c,--config", options.config, "The chains [chains.yaml]");
    command->add_option("--profile", options.profile,
                        "Kernels and times [<config's stem>.profile.json, if it exists]");
    command->add_option("--mode", options.mode, "off, observe or enforce [as configured]");
    command->add_flag("--observe", options.observe, "Count frames and misses, change nothing");
    command->add_option("--preset", options.preset,
                        "Scheduler settings instead of the config's: " + config::preset_names());
    command->add_option("--stats", options.stats, "Write every chain's statistics (JSON) at exit");
    command->add_flag("--quiet", options.quiet, "No summary on stderr at exit, no warnings");
    command->add_option("--real-libcuda", options.real_libcuda,
                        "The driver's library, instead of searching for it");
    return command;
}

int cmd_run(const RunOptions& options, const std::vector<std::string>& program) {
    const std::string wrong = check(options);
    if (!wrong.empty()) return fail(kExitUsage, wrong);

    const auto interposer = interposer_library();
    if (!interposer) return fail(kExitUsage, interposer.error());
    if (interposer->find_first_of(" :;") != std::string::npos) {
        return fail(kExitUsage, *interposer +
                                    ": the loader cannot preload from a path with spaces, "
                                    "colons or semicolons");
    }

    const Environment environment = current_environment();
    const auto search_path = environment.find("PATH");
    const FoundProgram found =
        find_program(program.front(), search_path == environment.end() ? "" : search_path->second);
    if (found.path.empty()) return fail(found.exit_code, found.message);
    const std::string obstacle = why_not_preloadable(found.path, getuid(), getgid());
    if (!obstacle.empty()) {
        return fail(kExitUsage,
                    found.path + ": " + obstacle + ", so the loader will not let UrgenGo in");
    }

    const auto resolved = resolve({options.config.empty() ? kDefaultConfig : options.config,
                                   options.profile, options.preset});
    if (!resolved) return fail(kExitUsage, resolved.error());
    if (!options.quiet) {
        for (const std::string& warning : resolved->warnings) {
            fmt::print(stderr, "urgengo: warning: {}\n", warning);
        }
    }

    ScheduledProgram scheduled;
    scheduled.interposer = library_for(*interposer, absolute(options.real_libcuda), environment);
    scheduled.config = resolved->path;
    scheduled.mode = options.observe ? "observe" : options.mode;
    scheduled.stats = absolute(options.stats);
    scheduled.real_libcuda = absolute(options.real_libcuda);
    scheduled.summary = !options.quiet;
    scheduled.nvtx = uses_nvtx(resolved->config);
    // Only scheduling may change the program's timing.
    const auto mode = effective_mode(scheduled.mode, environment, resolved->config.mode);
    if (mode == config::Mode::kEnforce) scheduled.connections = resolved->config.connections;
    return become(found.path, program, scheduled_environment(environment, scheduled));
}

}  // namespace urgengo::cli
