// SPDX-License-Identifier: Apache-2.0
#include "tests/interposer/run_twin.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string_view>

#include "host/config/presets.h"
#include "host/config/resolved_config.h"
#include "tests/support/catch.h"

namespace urgengo::testing {
namespace {

namespace fs = std::filesystem;

std::vector<char*> pointers(std::vector<std::string>& texts) {
    std::vector<char*> list;
    for (std::string& text : texts) list.push_back(text.data());
    list.push_back(nullptr);
    return list;
}

}  // namespace

bool on_real_gpu() {
    const char* const driver = std::getenv("URGENGO_TEST_DRIVER");
    if (!driver || !*driver || std::string_view(driver) == "simulated") return false;
    INFO("URGENGO_TEST_DRIVER: found '" << driver << "', accepted: simulated, real");
    REQUIRE(std::string_view(driver) == "real");
    return true;
}

std::string placed(const std::string& path) {
    constexpr std::string_view kBuild = BUILD_FOLDER;
    const char* const folder = std::getenv("URGENGO_TEST_FOLDER");
    if (!folder || !*folder || path.rfind(kBuild, 0) != 0) return path;
    return folder + path.substr(kBuild.size());
}

Running::Running(std::vector<std::string> arguments, const Environment& environment,
                 unsigned longest_s, int input) {
    const fs::path out = folder_.path() / "out", err = folder_.path() / "err";
    arguments.front() = placed(arguments.front());
    std::vector<std::string> variables;
    for (const auto& [name, value] : environment) variables.push_back(name + "=" + value);
    const std::vector<char*> argv = pointers(arguments), envp = pointers(variables);

    child_ = fork();
    REQUIRE(child_ >= 0);
    if (child_ == 0) {
        constexpr int kFlags = O_WRONLY | O_CREAT | O_TRUNC;
        if (input >= 0) dup2(input, STDIN_FILENO);
        dup2(open(out.c_str(), kFlags, 0600), STDOUT_FILENO);
        dup2(open(err.c_str(), kFlags, 0600), STDERR_FILENO);
        alarm(longest_s * (SANITIZED ? 4 : 1));
        execve(argv[0], argv.data(), envp.data());
        _exit(97);
    }
}

Outcome Running::wait() {
    int status = 0;
    REQUIRE(waitpid(child_, &status, 0) == child_);
    const int exit_status = WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
    return {exit_status, read_text(folder_.path() / "out"), read_text(folder_.path() / "err")};
}

Outcome run(const std::vector<std::string>& arguments, const Environment& environment) {
    return Running(arguments, environment).wait();
}

Outcome run_twin(const std::vector<std::string>& arguments, const Environment& environment) {
    std::vector<std::string> all{TWIN_PATH};
    all.insert(all.end(), arguments.begin(), arguments.end());
    return run(all, environment);
}

Environment bare() {
    Environment environment{{"PATH", "/usr/bin:/bin"}};
    if (on_real_gpu()) {
        // What a machine may need for its driver to be found and used.
        for (const char* name : {"LD_LIBRARY_PATH", "HOME", "CUDA_VISIBLE_DEVICES"})
            if (const char* value = std::getenv(name)) environment[name] = value;
    } else {
        environment["LD_LIBRARY_PATH"] = placed(SIMGPU_FOLDER);
        environment["TWIN_SIMGPU"] = placed(SIMGPU_FOLDER "/libcuda.so.1");
    }
#if SANITIZED
    // A preloaded library comes before the sanitizer's, which objects unless told otherwise.
    environment["ASAN_OPTIONS"] = "verify_asan_link_order=0:detect_leaks=0";
    // Without this undefined behaviour is only a line on stderr, which nobody compares.
    environment["UBSAN_OPTIONS"] = "halt_on_error=1:print_stacktrace=1";
#endif
    return environment;
}

Environment preloaded() {
    Environment environment = bare();
    environment["LD_PRELOAD"] = placed(INTERPOSER_FOLDER "/libcuda.so.1");
    if (!on_real_gpu()) environment["URGENGO_REAL_LIBCUDA"] = placed(SIMGPU_FOLDER "/libcuda.so.1");
    return environment;
}

Environment by_library_path() {
    Environment environment = bare();
    std::string& path = environment["LD_LIBRARY_PATH"];
    path = placed(INTERPOSER_FOLDER) + (path.empty() ? "" : ":" + path);
    return environment;
}

Environment with_driver(Environment environment, const std::string& driver) {
    const std::string folder = std::string(TEST_PROGRAMS "/") + driver;
    std::string& path = environment["LD_LIBRARY_PATH"];
    path = path == SIMGPU_FOLDER ? folder : INTERPOSER_FOLDER ":" + folder;
    if (environment.count("URGENGO_REAL_LIBCUDA"))
        environment["URGENGO_REAL_LIBCUDA"] = folder + "/libcuda.so.1";
    return environment;
}

Environment configured(Environment environment, const fs::path& config, const fs::path& stats) {
    environment["URGENGO_CONFIG"] = config.string();
    if (!stats.empty()) environment["URGENGO_STATS"] = stats.string();
    return environment;
}

std::string read_text(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
}

void write_text(const fs::path& path, const std::string& text) {
    std::ofstream(path, std::ios::binary) << text;
}

config::Chain chain(const std::string& name, std::chrono::nanoseconds deadline,
                    std::vector<config::Task> tasks) {
    config::Chain result;
    result.name = name;
    result.period = result.deadline = deadline;
    result.tasks = std::move(tasks);
    return result;
}

fs::path write_config(const fs::path& path, const std::string& preset, config::Mode mode,
                      std::vector<config::Chain> chains, const config::Profile* profile,
                      const std::function<void(config::Config&)>& change) {
    config::Config config;
    config.mode = mode;
    config.chains = std::move(chains);
    config.scheduler = config::preset(preset).value();
    // Short enough for many tests; long enough that launches are held at all.
    config.scheduler.hold.max_per_instance = std::chrono::milliseconds(40);
    if (change) change(config);
    write_text(path, config::to_resolved_json(config, profile, {}));
    return path;
}

std::vector<std::string> lines_of(const std::string& text) {
    std::vector<std::string> lines;
    std::istringstream stream(text);
    for (std::string line; std::getline(stream, line);) lines.push_back(line);
    return lines;
}

config::TaskProfile periods_profile(int kernels, std::chrono::nanoseconds each) {
    config::TaskProfile task;
    task.name = "work";
    for (int i = 0; i < kernels; ++i) task.kernels.push_back({"half_ms", 46, 1024, each, 1.0});
    const auto n = static_cast<std::uint32_t>(kernels);
    task.segments = {{std::chrono::microseconds(1), n, n, n, "stream"}};
    return task;
}

config::TaskProfile scheduling_profile(const std::string& chain_name) {
    config::TaskProfile task;
    task.name = "work";
    for (int i = 0; i < kSchedulingKernels; ++i)
        task.kernels.push_back(
            {chain_name + "_" + std::to_string(i), 46, 1024, std::chrono::milliseconds(50), 1.0});
    return task;
}

Environment held_for_ever(const Folder& folder) {
    config::TaskProfile task;
    task.name = "work";
    task.kernels.assign(2, {"endless", 46, 1024, std::chrono::seconds(600), 1.0});
    config::Profile profile;
    profile.chains = {{"tight", {task}}, {"loose", {task}}};
    const auto config =
        write_config(folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
                     {chain("tight", std::chrono::hours(1), {{"work", ""}}),
                      chain("loose", std::chrono::hours(2), {{"work", ""}})},
                     &profile, [](config::Config& c) {
                         c.scheduler.hold.max_per_instance = std::chrono::hours(1);
                         c.scheduler.packing.share_slack = std::chrono::hours(1);
                     });
    Environment environment = configured(preloaded(), config);
    environment["URGENGO_SHARE"] = folder.path().string();
    return environment;
}

}  // namespace urgengo::testing
