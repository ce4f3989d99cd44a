// SPDX-License-Identifier: Apache-2.0
//
// urgengo run: the environment that the program gets, which programs are refused and why, the
// resolved file that is written, and the exit codes.
#include <elf.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "host/config/file_text.h"
#include "host/config/resolved_config.h"
#include "tests/support/catch.h"
#include "tools/urgengo/bench_plan.h"
#include "tools/urgengo/bench_results.h"
#include "tools/urgengo/bench_table.h"
#include "tools/urgengo/environment.h"
#include "tools/urgengo/program_check.h"
#include "tools/urgengo/pruned_library.h"
#include "tools/urgengo/resolve.h"
#include "tools/urgengo/run_process.h"
#include "tools/urgengo/temporary_folder.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;

constexpr char kYaml[] =
    "version: 1\nchains: [{name: C0, period_ms: 1, deadline_ms: 1, tasks: [{name: t}]}]\n"
    "scheduler: {pack_limit: 2}\n";

struct Folder {
    Folder() {
        auto made = TemporaryFolder::make();
        REQUIRE(made);
        folder = std::move(*made);
    }
    std::string path(const std::string& name) const { return folder->path() + "/" + name; }
    std::string write(const std::string& name, const std::string& bytes, mode_t mode = 0644) const {
        std::ofstream(path(name), std::ios::binary) << bytes;
        REQUIRE(chmod(path(name).c_str(), mode) == 0);
        return path(name);
    }
    std::unique_ptr<TemporaryFolder> folder;
};

ScheduledProgram some_program() {
    ScheduledProgram program;
    program.interposer = "/opt/u/lib/urgengo/libcuda.so.1";
    program.config = "/tmp/c.resolved.json";
    program.connections = 16;
    return program;
}

/// A 64-bit ELF file with one program header of this type.
std::string elf_file(std::uint32_t segment_type, unsigned char elf_class = ELFCLASS64) {
    Elf64_Ehdr header{};
    std::copy_n(ELFMAG, SELFMAG, header.e_ident);
    header.e_ident[EI_CLASS] = elf_class;
    header.e_type = ET_DYN;
    header.e_phoff = sizeof header;
    header.e_phentsize = sizeof(Elf64_Phdr);
    header.e_phnum = 2;
    Elf64_Phdr load{}, segment{};
    load.p_type = PT_LOAD;
    segment.p_type = segment_type;
    std::string bytes(reinterpret_cast<const char*>(&header), sizeof header);
    bytes.append(reinterpret_cast<const char*>(&load), sizeof load);
    return bytes.append(reinterpret_cast<const char*>(&segment), sizeof segment);
}

TEST_CASE("Scheduled environment names us as the NVTX tool when no other is named", "[unit][cli]") {
    ScheduledProgram program = some_program();
    CHECK(scheduled_environment({}, program).count("NVTX_INJECTION64_PATH") == 0);
    program.nvtx = true;
    const Environment environment = scheduled_environment({}, program);
    CHECK(environment.at("NVTX_INJECTION64_PATH") == program.interposer);
    CHECK(bare_environment(environment, program.interposer).count("NVTX_INJECTION64_PATH") == 0);
    const Environment other = {{"NVTX_INJECTION64_PATH", "/other.so"}};
    CHECK(scheduled_environment(other, program).at("NVTX_INJECTION64_PATH") == "/other.so");
    CHECK(bare_environment(other, program.interposer) == other);
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

TEST_CASE("Program is refused when the loader would not let us in", "[unit][cli]") {
    const Folder folder;
    const uid_t uid = getuid();
    const gid_t gid = getgid();
    const auto why = [&](const std::string& bytes, mode_t mode = 0755) {
        return why_not_preloadable(folder.write("program", bytes, mode), uid, gid);
    };
    CHECK(why(elf_file(PT_INTERP)).empty());
    CHECK(why(elf_file(PT_NOTE)) == "it is statically linked");
    CHECK(why(elf_file(PT_INTERP, ELFCLASS32)) == "it is not a 64-bit program");
    CHECK(why(elf_file(PT_INTERP).substr(0, sizeof(Elf64_Ehdr))) == "it is statically linked");
    CHECK(why("#!/bin/sh\necho\n").empty());
    CHECK(why("").empty());
    CHECK(why_not_preloadable("/bin/sh", uid, gid).empty());

    const std::string setuid = folder.write("setuid", elf_file(PT_INTERP), 04755);
    CHECK(why_not_preloadable(setuid, uid, gid).empty());  // gains nothing
    CHECK(why_not_preloadable(setuid, uid + 1, gid) == "it is setuid");
    const std::string setgid = folder.write("setgid", elf_file(PT_INTERP), 02755);
    CHECK(why_not_preloadable(setgid, uid, gid + 1) == "it is setgid");
}

TEST_CASE("Program is found as a shell finds it when it is named", "[unit][cli]") {
    const Folder folder;
    const std::string tool = folder.write("tool", "#!/bin/sh\n", 0755);
    const std::string text = folder.write("text", "", 0644);
    CHECK(find_program(tool, "").path == tool);
    CHECK(find_program("tool", "/nonexistent:" + folder.folder->path()).path == tool);
    CHECK(find_program("tool", "/nonexistent").exit_code == 127);
    CHECK(find_program("tool", "/nonexistent").message == "tool: no such program in $PATH");
    CHECK(find_program(folder.path("none"), "").exit_code == 127);
    CHECK(find_program(text, "").exit_code == 126);
    CHECK(find_program("text", folder.folder->path()).message == text + ": not an executable file");
    CHECK(find_program(folder.folder->path(), "").exit_code == 126);
    CHECK(find_program("", "/bin").exit_code == 127);
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
    CHECK(loaded->config.scheduler.pack_limit == 2);
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

TEST_CASE("Bench plan gives every row the same arrivals when it has several", "[unit][cli]") {
    BenchOptions options;
    options.f_a = {0.9};
    options.repeats = 2;
    options.seed = 5;
    options.rows = {"bare", "urgengo"};
    options.umin = 0.5;
    options.sync = "block";
    const BenchPaths paths{"/bin/urgengo", "/bin/chains", "/t/workload.json", "/t", "/sim"};
    const BenchPlan plan = make_plan(options, paths);
    CHECK(shell_line(plan.calibrate) == "/bin/chains calibrate --out /t/workload.json --umin 0.5");
    REQUIRE(plan.levels.size() == 1);
    CHECK(shell_line(plan.levels[0].write_config) ==
          "/bin/chains config --workload /t/workload.json --f-a 0.9 --f-d 1 --yaml /t/f_a_0.9.yaml "
          "--profile /t/f_a_0.9.profile.json");
    REQUIRE(plan.runs.size() == 4);
    const std::string program =
        "/bin/chains run --workload /t/workload.json --f-a 0.9 --f-d 1 --seconds 12 --seed ";
    CHECK(shell_line(plan.runs[0].arguments) ==
          program + "5 --sync block --json /t/bare_0.9_0.json --quiet");
    CHECK(shell_line(plan.runs[1].arguments) ==
          "/bin/urgengo run -c /t/f_a_0.9.yaml --quiet --profile /t/f_a_0.9.profile.json --preset "
          "urgengo --stats /t/urgengo_0.9_0.stats.json --real-libcuda /sim -- " +
              program + "5 --sync block --json /t/urgengo_0.9_0.json --quiet");
    CHECK(plan.runs[2].seed == 6);
    CHECK(plan.runs[2].row == "bare");

    options.workload = "/given.json";
    CHECK(make_plan(options, paths).calibrate.empty());
}

TEST_CASE("Bench options are refused when a row or a level makes no sense", "[unit][cli]") {
    BenchOptions options;
    CHECK(check(options).empty());
    options.rows = {"bare", "paper"};
    CHECK(check(options) ==
          "--rows: found 'paper', accepted: bare, urgengo, urgency, edf, vanilla");
    options.rows = {"bare", "bare"};
    CHECK(check(options) == "--rows: found 'bare' twice, accepted: once");
    options.rows = {"bare"};
    options.f_a = {1, 1};
    CHECK(check(options) == "--f-a: found the same number twice, accepted: once");
}

TEST_CASE("Bench table shows medians and ranges when there are repeats", "[unit][cli]") {
    BenchResults results;
    results.rows = {"bare", "urgengo"};
    results.levels = {0.9};
    const auto add = [&](const char* row, double miss_pct, double exited) {
        RunResult run;
        run.row = row;
        run.f_a = 0.9;
        run.miss_pct = miss_pct;
        run.exited = exited;
        run.cpu_cores = 1.5;
        run.chains = {{"C0", 42, miss_pct}};
        results.runs.push_back(run);
    };
    for (const double miss_pct : {30.0, 10.0, 20.0}) add("bare", miss_pct, 0);
    for (const double miss_pct : {1.0, 1.0, 1.0}) add("urgengo", miss_pct, miss_pct * 4);
    CHECK(format_table(results) ==
          "                   f_a 0.9\n"
          "                    miss %  exited  cores\n"
          "bare     20.0 (10.0..30.0)       0   1.50\n"
          "urgengo                1.0       4   1.50\n"
          "\n"
          "miss %                         f_a 0.9\n"
          "chain   deadline ms               bare  urgengo\n"
          "C0             42.0  20.0 (10.0..30.0)      1.0\n");
    CHECK(spread({4, 1, 2, 3}).median == 2.5);
}

TEST_CASE("Bench reads a report, and says what is wrong, when it is there", "[unit][cli]") {
    const std::string good =
        R"({"gpu":"G","kernel_driver_version":null,"cuda_driver_version":"13.0","urgengo":"off",
"overall_miss_ratio":0.25,"cpu_cores":1.5,"chains":[
{"name":"C0","deadline_ms":42,"miss_ratio":0.5,"exited":3},
{"name":"C1","deadline_ms":90,"miss_ratio":0,"exited":1}]})";
    const auto run = parse_report(good, "r.json");
    REQUIRE(run);
    CHECK(run->driver == "CUDA 13.0");
    CHECK(run->miss_pct == 25);
    CHECK(run->exited == 4);
    REQUIRE(run->chains.size() == 2);
    CHECK(run->chains[0].miss_pct == 50);
    CHECK(parse_report("{}", "r.json").error() == "r.json: $.gpu: missing, and required");
}

}  // namespace
}  // namespace urgengo::cli
