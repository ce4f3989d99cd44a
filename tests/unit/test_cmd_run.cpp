// SPDX-License-Identifier: Apache-2.0
//
// urgengo run: the environment that the program gets, the resolved file that is written, which
// profiles are refused, and the exit codes.
#include <cstdlib>
#include <filesystem>
#include <string>

#include "host/config/file_text.h"
#include "host/config/resolved_config.h"
#include "tests/support/catch.h"
#include "tests/support/folder.h"
#include "tools/urgengo/environment.h"
#include "tools/urgengo/program/environment_check.h"
#include "tools/urgengo/program/pruned_library.h"
#include "tools/urgengo/program/run_process.h"
#include "tools/urgengo/resolve.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;
using testing::Folder;

constexpr char kYaml[] =
    "version: 1\nchains: [{name: C0, period_ms: 1, deadline_ms: 1, tasks: [{name: t}]}]\n"
    "scheduler: {pack_limit: 2}\n";

/// An answer to what the program will run on.
std::function<config::RunTarget()> runs_on(const config::RunTarget& target) {
    return [target] { return target; };
}

ScheduledProgram some_program() {
    ScheduledProgram program;
    program.interposer = "/opt/u/lib/urgengo/libcuda.so.1";
    program.config = "/tmp/c.resolved.json";
    program.connections = 16;
    return program;
}

TEST_CASE("Scheduled environment names us as the NVTX tool when a task has NVTX ranges",
          "[unit][cli]") {
    ScheduledProgram program = some_program();
    CHECK(scheduled_environment({}, program).count("NVTX_INJECTION64_PATH") == 0);
    program.nvtx = true;
    const Environment environment = scheduled_environment({}, program);
    CHECK(environment.at("NVTX_INJECTION64_PATH") == program.interposer);
    CHECK(bare_environment(environment, program.interposer).count("NVTX_INJECTION64_PATH") == 0);
    const Environment other = {{"NVTX_INJECTION64_PATH", "/other.so"}};
    CHECK(bare_environment(other, program.interposer) == other);
}

TEST_CASE("Scheduled environment keeps the NVTX tool that it finds behind us when we are one",
          "[unit][cli]") {
    ScheduledProgram program = some_program();
    const Environment other = {{"NVTX_INJECTION64_PATH", "/other.so"}};
    const Environment untouched = scheduled_environment(other, program);
    CHECK(untouched.at("NVTX_INJECTION64_PATH") == "/other.so");
    CHECK(untouched.count("URGENGO_NVTX_TOOL") == 0);
    program.nvtx = true;
    const Environment chained = scheduled_environment(other, program);
    CHECK(chained.at("NVTX_INJECTION64_PATH") == program.interposer);
    CHECK(chained.at("URGENGO_NVTX_TOOL") == "/other.so");
    CHECK(scheduled_environment(chained, program) == chained);  // twice is once
    const Environment bare = bare_environment(chained, program.interposer);
    CHECK(bare.at("NVTX_INJECTION64_PATH") == "/other.so");
    CHECK(bare.count("URGENGO_NVTX_TOOL") == 0);
}

TEST_CASE("Cache folder is the user's when the environment names one", "[unit][cli]") {
    CHECK(cache_folder({}).empty());
    CHECK(cache_folder({{"HOME", "/home/u"}}) == "/home/u/.cache/urgengo");
    CHECK(cache_folder({{"HOME", "/home/u"}, {"XDG_CACHE_HOME", "/c"}}) == "/c/urgengo");
    CHECK(cache_folder({{"HOME", "/home/u"}, {"XDG_CACHE_HOME", "c"}}) == "/home/u/.cache/urgengo");
}

TEST_CASE("Scheduled environment has our library first when others are preloaded", "[unit][cli]") {
    const Environment bare = {{"LD_PRELOAD", "/a.so /b.so:/c.so"}, {"LD_LIBRARY_PATH", "/x:/y"}};
    const Environment env = scheduled_environment(bare, some_program());
    CHECK(env.at("LD_PRELOAD") == "/opt/u/lib/urgengo/libcuda.so.1:/a.so:/b.so:/c.so");
    CHECK(env.at("LD_LIBRARY_PATH") == "/opt/u/lib/urgengo:/x:/y");
    CHECK(scheduled_environment(env, some_program()) == env);  // twice is once
}

TEST_CASE("Scheduled environment sets only what was asked for when little is", "[unit][cli]") {
    const Environment env = scheduled_environment({{"HOME", "/h"}}, some_program());
    CHECK(env == Environment{{"HOME", "/h"},
                             {"LD_PRELOAD", "/opt/u/lib/urgengo/libcuda.so.1"},
                             {"LD_LIBRARY_PATH", "/opt/u/lib/urgengo"},
                             {"URGENGO_CONFIG", "/tmp/c.resolved.json"},
                             {"URGENGO_SUMMARY", "1"},
                             {"CUDA_DEVICE_MAX_CONNECTIONS", "16"}});
}

TEST_CASE("Scheduled environment has mode, statistics and driver when they are asked for",
          "[unit][cli]") {
    ScheduledProgram program = some_program();
    program.mode = "observe";
    program.stats = "/tmp/s.json";
    program.real_libcuda = "/sim/libcuda.so.1";
    program.summary = false;
    const Environment env =
        scheduled_environment({{"URGENGO_MODE", "off"}, {"URGENGO_SUMMARY", "1"}}, program);
    CHECK(env.at("URGENGO_MODE") == "observe");
    CHECK(env.at("URGENGO_STATS") == "/tmp/s.json");
    CHECK(env.at("URGENGO_REAL_LIBCUDA") == "/sim/libcuda.so.1");
    CHECK(env.at("URGENGO_SUMMARY") == "0");
}

TEST_CASE("Scheduled environment leaves the connections alone when they are set or kept",
          "[unit][cli]") {
    const Environment set = {{"CUDA_DEVICE_MAX_CONNECTIONS", "8"}};
    CHECK(scheduled_environment(set, some_program()).at("CUDA_DEVICE_MAX_CONNECTIONS") == "8");
    ScheduledProgram keep = some_program();
    keep.connections = 0;
    CHECK(scheduled_environment({}, keep).count("CUDA_DEVICE_MAX_CONNECTIONS") == 0);
}

TEST_CASE("Bare environment has no trace of UrgenGo when there was one", "[unit][cli]") {
    const Environment own = {{"HOME", "/h"}, {"LD_PRELOAD", "/a.so"}};
    Environment scheduled = scheduled_environment(own, some_program());
    scheduled.erase("LD_LIBRARY_PATH");
    scheduled.erase("CUDA_DEVICE_MAX_CONNECTIONS");
    CHECK(bare_environment(scheduled, some_program().interposer) == own);
    CHECK(bare_environment({{"LD_PRELOAD", "/i.so"}}, "/i.so").empty());
}

TEST_CASE("Resolving writes what the interposer takes for the YAML when nothing is overridden",
          "[unit][cli]") {
    const Folder folder;
    const std::string yaml = folder.write("chains.yaml", kYaml);
    const auto resolved = resolve({yaml, "", ""});
    REQUIRE(resolved);
    CHECK(resolved->path == folder.path("chains.resolved.json"));
    const auto loaded = config::load_for_interposer(yaml);
    REQUIRE(loaded);
    CHECK(loaded->config.chains[0].name == "C0");
    CHECK_FALSE(loaded->profile);

    folder.write("chains.profile.json",
                 R"({"format_version":2,"gpu":"","driver":"","chains":[{"name":"X","tasks":[]}]})");
    const auto with_profile = resolve({yaml, "", ""});
    REQUIRE(with_profile);
    CHECK(with_profile->warnings.size() == 2);
    REQUIRE(config::load_for_interposer(yaml));
    CHECK(config::load_for_interposer(yaml)->profile);

    folder.write("chains.profile.json", "{}");
    CHECK_FALSE(config::load_for_interposer(yaml));
    CHECK(resolve({yaml, "", ""}).error() ==
          folder.path("chains.profile.json") + ": $.format_version: missing, and required");
}

TEST_CASE("Resolving refuses a profile of another GPU or program when it is not to be stale",
          "[unit][cli]") {
    const Folder folder;
    const std::string yaml = folder.write("chains.yaml", kYaml);
    const std::string profile = folder.write(
        "chains.profile.json",
        R"({"format_version":2,"gpu":"G","driver":"12.4","program":"stack","chains":[]})");
    const auto request = [&](const config::RunTarget& target, bool allow_stale) {
        return resolve({yaml, "", "", allow_stale, runs_on(target)});
    };
    const config::RunTarget same{"G", "12.4", 0, 0, "stack"};
    REQUIRE(request(same, false));
    const std::size_t num_warnings = request(same, false)->warnings.size();
    fs::remove(folder.path("chains.resolved.json"));

    const auto refused = request({"H", "13.0", 0, 0, "other"}, false);
    REQUIRE_FALSE(refused);
    CHECK(refused.error() ==
          profile +
              ": gpu: found 'G' in the profile, accepted: 'H', as it is here; program: found "
              "'stack' in the profile, accepted: 'other', as it is here (profile again, or use it "
              "all the same: --allow-stale)");
    CHECK_FALSE(fs::exists(folder.path("chains.resolved.json")));

    const auto allowed = request({"H", "13.0", 0, 0, "other"}, true);
    REQUIRE(allowed);
    CHECK(allowed->warnings.size() == num_warnings + 3);
    CHECK(fs::exists(folder.path("chains.resolved.json")));
    const auto other_driver = request({"G", "13.0", 0, 0, "stack"}, false);
    REQUIRE(other_driver);
    CHECK(other_driver->warnings.back() ==
          profile + ": driver: found '12.4' in the profile, accepted: '13.0', as it is here");
}

TEST_CASE("Environment is refused when a variable has a value that nothing accepts",
          "[unit][cli]") {
    const Folder folder;
    const auto error = [](const std::string& name, const std::string& value) {
        return check_environment({{name, value}}).error;
    };
    CHECK(error("URGENGO_MODE", "x") ==
          "URGENGO_MODE: found 'x', accepted: off, observe, shadow, enforce");
    CHECK(error("URGENGO_MODE", "observe").empty());
    CHECK(error("URGENGO_MODE", "").empty());
    CHECK(error("URGENGO_SUMMARY", "yes") == "URGENGO_SUMMARY: found 'yes', accepted: 0, 1");
    CHECK(error("URGENGO_REAL_LIBCUDA", "/nonexistent/libcuda.so.1") ==
          "URGENGO_REAL_LIBCUDA: found '/nonexistent/libcuda.so.1', accepted: the absolute path of "
          "a libcuda.so.1");
    CHECK(error("URGENGO_STATS", "/nonexistent/s.json") ==
          "URGENGO_STATS: found '/nonexistent/s.json', accepted: a file that can be written "
          "(/nonexistent: No such file or directory)");
    CHECK(error("URGENGO_STATS", "/dev/null/s.json") ==
          "URGENGO_STATS: found '/dev/null/s.json', accepted: a file that can be written "
          "(/dev/null: Not a directory)");
    CHECK(error("URGENGO_TRACE", folder.path().string()) ==
          "URGENGO_TRACE: found '" + folder.path().string() +
              "', accepted: a file that can be written (it is a folder)");
    CHECK(error("URGENGO_STATS", folder.path("s.json")).empty());
    CHECK(error("URGENGO_STATS", "s.json").empty());
    CHECK(error("OTHER_MODE", "x").empty());
}

TEST_CASE("Environment's variables are warned of when nothing reads them", "[unit][cli]") {
    const auto check = check_environment({{"URGENGO_MOD", "x"}, {"URGENGO_COLOUR", "red"}});
    CHECK(check.error.empty());
    CHECK(check.warnings ==
          std::vector<std::string>{
              "URGENGO_COLOUR: nothing reads this variable",
              "URGENGO_MOD: nothing reads this variable (did you mean 'URGENGO_MODE'?)"});
    CHECK(check_environment({{"URGENGO_MODE", "off"}, {"HOME", "/"}}).warnings.empty());
}

TEST_CASE("Resolving keeps the YAML's own file when a preset is handed in", "[unit][cli]") {
    const Folder folder;
    const std::string yaml = folder.write("chains.yaml", kYaml);
    const auto resolved = resolve({yaml, "", "vanilla"});
    REQUIRE(resolved);
    CHECK(resolved->path == folder.path("chains.vanilla.resolved.json"));
    CHECK_FALSE(fs::exists(folder.path("chains.resolved.json")));
    const auto loaded = config::load_for_interposer(resolved->path);
    REQUIRE(loaded);
    CHECK(loaded->config.scheduler.preset == "vanilla");
    CHECK(loaded->config.scheduler.admission == config::Admission::kNone);
    CHECK(loaded->config.scheduler.packing.limit == 2);
}

TEST_CASE("Resolving writes into the session's folder when the YAML's cannot be written to",
          "[unit][cli]") {
    const Folder folder;
    const std::string yaml = folder.write("chains.yaml", kYaml);
    // A folder in the file's place stops root too, whom permissions do not.
    fs::create_directories(folder.path("chains.resolved.json") + "/occupied");
    const std::string runtime = folder.path("runtime");
    fs::create_directory(runtime);
    const char* before = std::getenv("XDG_RUNTIME_DIR");
    const std::string restored = before ? before : "";
    setenv("XDG_RUNTIME_DIR", runtime.c_str(), 1);
    const auto resolved = resolve({yaml, "", ""});
    fs::permissions(runtime + "/urgengo", fs::perms::others_exec, fs::perm_options::add);
    const auto refused = resolve({yaml, "", ""});
    before ? setenv("XDG_RUNTIME_DIR", restored.c_str(), 1) : unsetenv("XDG_RUNTIME_DIR");

    REQUIRE(resolved);
    CHECK(resolved->path.starts_with(runtime + "/urgengo/"));
    const auto loaded = config::load_for_interposer(resolved->path);
    REQUIRE(loaded);
    CHECK(loaded->source[0].path == yaml);
    CHECK_FALSE(refused);  // a folder that others can enter is not trusted
}

TEST_CASE("Child's output and exit code come back when it ends", "[unit][cli]") {
    const auto run = [](const std::string& script) {
        const auto result = run_process({"/bin/sh", "-c", script}, {{"X", "y"}});
        REQUIRE(result);
        return *result;
    };
    CHECK(run("echo $X; echo e >&2; exit 3").exit_code == 3);
    CHECK(run("echo $X; echo e >&2; exit 3").output == "y\ne\n");
    CHECK(run("kill -9 $$").exit_code == 128 + 9);
    const std::string tail = run("i=0; while [ $i -lt 20000 ]; do echo 0123456789; i=$((i+1)); "
                                 "done; echo end")
                                 .output;
    CHECK(tail.size() == 64 * 1024);
    CHECK(tail.ends_with("end\n"));
    CHECK(run_process({"/nonexistent"}, {})->exit_code == 127);
}

TEST_CASE("Child gets the signal and the caller knows when it is interrupted", "[unit][cli]") {
    const auto result =
        run_process({"/bin/sh", "-c", "trap 'exit 7' INT; kill -INT $PPID; sleep 5 & wait"}, {});
    REQUIRE(result);
    CHECK(result->interrupted);
    CHECK(result->exit_code == 7);
}

TEST_CASE("Shell line quotes what a shell would take apart when there is such a thing",
          "[unit][cli]") {
    CHECK(shell_line({"urgengo", "--f-a", "0.7", "a b", "it's", ""}) ==
          "urgengo --f-a 0.7 'a b' 'it'\\''s' ''");
}

}  // namespace
}  // namespace urgengo::cli
