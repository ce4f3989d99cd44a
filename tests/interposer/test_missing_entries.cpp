// SPDX-License-Identifier: Apache-2.0
//
// A driver may be older than our list of names, and may have one function under two names: what the
// loader answers must be what it answers without us, so that a program which cannot run on this
// driver fails as it does without us, and one that looks before it calls sees what is there.
#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <filesystem>

#include "interposer/elf_symbols.h"
#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo::testing;

namespace {

namespace fs = std::filesystem;

const std::string kPrograms = TEST_PROGRAMS;

/// By `urgengo run`, which puts its copies into `cache`.
Outcome run_scheduled(const std::vector<std::string>& program, const std::string& driver,
                      const fs::path& cache, const fs::path& folder, bool quiet = true) {
    Environment environment = with_driver(bare(), driver);
    environment["XDG_CACHE_HOME"] = cache.string();
    const fs::path config = folder / "chains.yaml";
    write_text(config,
               "version: 1\nchains: [{name: C0, period_ms: 10, deadline_ms: 10, "
               "tasks: [{name: t, thread: none}]}]\n");
    std::vector<std::string> arguments{URGENGO_PATH, "run", "-c", config};
    if (quiet) arguments.push_back("--quiet");
    arguments.push_back("--");
    arguments.insert(arguments.end(), program.begin(), program.end());
    return run(arguments, environment);
}

void check_equal(const Outcome& found, const Outcome& expected) {
    CHECK(found.exit_status == expected.exit_status);
    CHECK(found.out == expected.out);
    CHECK(found.err == expected.err);
}

const std::vector<std::string> kAsked{"cuLaunchKernel",        "cuLaunchKernelEx",
                                      "cuLaunchKernelEx_ptsz", "cuGLInit",
                                      "cuMemcpyBatchAsync",    "cuMemFree",
                                      "cuMemFree_v2",          "cuProfilerStart",
                                      "cuStreamSynchronize",   "cuStreamSynchronize_ptsz",
                                      "cuArrayCreate",         "cuCtxCreate",
                                      "cuCtxCreate_v2",        "cuNoSuchFunction"};

Environment with_new_names(Environment environment) {
    environment["URGENGO_NEW_NAMES"] = "1";
    return with_driver(std::move(environment), "newer_driver");
}

}  // namespace

TEST_CASE("Loader finds what the driver has when names are missing or share a function",
          "[interposer][missing]") {
    const std::string driver = GENERATE("stub_driver", "old_driver", "alias_driver");
    INFO(driver);
    std::vector<std::string> arguments{kPrograms + "/ask_loader", "ask"};
    arguments.insert(arguments.end(), kAsked.begin(), kAsked.end());
    const Outcome expected = run(arguments, with_driver(bare(), driver));
    REQUIRE(expected.exit_status == 0);
    const bool old = driver == "old_driver", alias = driver == "alias_driver";
    CHECK((expected.out.find("cuLaunchKernelEx: not found") != std::string::npos) == old);
    CHECK((expected.out.find("cuArrayCreate: is cuLaunchKernel,") != std::string::npos) == alias);
    check_equal(run(arguments, with_driver(preloaded(), driver)), expected);
    check_equal(run(arguments, with_driver(by_library_path(), driver)), expected);
}

TEST_CASE("Loader does not find what UrgenGo does not know unless it is asked to",
          "[interposer][missing]") {
    const Outcome found =
        run({kPrograms + "/ask_loader", "ask", "cuFunctionOfTomorrow", "cuLaunchKernel"},
            with_driver(preloaded(), "newer_driver"));
    CHECK(found.out.find("cuFunctionOfTomorrow: not found") != std::string::npos);
    CHECK(found.out.find("cuLaunchKernel: not found") == std::string::npos);
}

TEST_CASE("Loader finds what UrgenGo does not know when the driver has it",
          "[interposer][missing]") {
    for (const std::string how : {"ask", "call"}) {
        std::vector<std::string> arguments{kPrograms + "/ask_loader", how};
        arguments.insert(arguments.end(), {"cuNvtxGetInjectionInitializer", "cuFunctionOfTomorrow",
                                           "cuFunctionOfTomorrov", "ug_spare_00", "ug_spare_05"});
        // What UrgenGo implements would look into the numbers.
        if (how == "ask") arguments.insert(arguments.end(), kAsked.begin(), kAsked.end());
        const Outcome expected = run(arguments, with_driver(bare(), "newer_driver"));
        REQUIRE(expected.exit_status == 0);
        CHECK(expected.out.find("cuNvtxGetInjectionInitializer: is") != std::string::npos);
        check_equal(run(arguments, with_new_names(preloaded())), expected);
        check_equal(run(arguments, with_new_names(by_library_path())), expected);
    }
}

TEST_CASE("Loader finds all that the driver has when some of it is new to UrgenGo",
          "[interposer][missing]") {
    std::vector<std::string> arguments{kPrograms + "/ask_loader", "ask", "cuFunctionOfTomorrow"};
    const std::string driver = read_text(kPrograms + "/stub_driver/libcuda.so.1");
    for (const auto& symbol : urgengo::interposer::defined_symbols(driver))
        if (symbol.name.starts_with("cu")) arguments.emplace_back(symbol.name);
    REQUIRE(arguments.size() > 600);
    const Outcome expected = run(arguments, with_driver(bare(), "newer_driver"));
    check_equal(run(arguments, with_new_names(preloaded())), expected);
}

TEST_CASE("Lazily bound program fails as it would bare when the driver lacks what it calls",
          "[interposer][missing]") {
    const std::string program = kPrograms + "/needs_entry_lazy";
    const Environment alone = with_driver(bare(), "old_driver");
    const Environment with_urgengo = with_driver(preloaded(), "old_driver");
    const Outcome fails = run({program, "call"}, alone), passes = run({program}, alone);
    CHECK(fails.exit_status == 127);
    CHECK(lines_of(fails.out).size() == 1);
    CHECK(passes.exit_status == 0);
    check_equal(run({program, "call"}, with_urgengo), fails);
    check_equal(run({program}, with_urgengo), passes);
    check_equal(run({program, "call"}, with_driver(by_library_path(), "old_driver")), fails);
}

TEST_CASE("Eagerly bound program fails as it would bare when urgengo run starts it",
          "[interposer][missing]") {
    const std::string program = kPrograms + "/needs_entry_now";
    const Folder folder;
    const fs::path cache = folder.path() / "cache";
    const Outcome fails = run({program}, with_driver(bare(), "old_driver"));
    CHECK(fails.exit_status == 127);
    CHECK(fails.out.empty());
    // The first run makes the copy, the second finds it.
    for (int i = 0; i < 2; ++i) {
        check_equal(run_scheduled({program}, "old_driver", cache, folder.path()), fails);
        const auto copies = std::distance(fs::directory_iterator(cache / "urgengo"), {});
        CHECK(copies == 1);
    }
    const fs::path copy = *fs::directory_iterator(cache / "urgengo");
    CHECK(fs::read_symlink(copy / "libcuda.so") == "libcuda.so.1");
    const std::string library = read_text(copy / "libcuda.so.1");
    std::size_t num_hints = 0;
    for (const auto& symbol : urgengo::interposer::defined_symbols(library)) {
        CHECK(symbol.name != "cuLaunchKernelEx");
        if (symbol.name.starts_with("ug_") && !symbol.name.starts_with("ug_spare_")) ++num_hints;
    }
    CHECK(num_hints == 5);

    // Where nothing is missing, nothing is copied.
    const Outcome passes = run({program}, with_driver(bare(), "stub_driver"));
    CHECK(passes.exit_status == 0);
    fs::remove_all(cache);
    check_equal(run_scheduled({program}, "stub_driver", cache, folder.path()), passes);
    CHECK(!fs::exists(cache));
}

TEST_CASE("Copies that nothing was started with for 30 days go when another one is made",
          "[interposer][missing]") {
    const Folder folder;
    const fs::path cache = folder.path() / "cache" / "urgengo";
    const auto now = fs::file_time_type::clock::now();
    const auto make = [&](const std::string& name, const std::string& file, int days) {
        fs::create_directories(cache / name);
        write_text(cache / name / file, "");
        fs::last_write_time(cache / name, now - std::chrono::hours(24 * days));
    };
    make("0123456789abcdef", "libcuda.so.1", 31);
    make("123456789abcdef0", "libcuda.so.1", 29);
    make("23456789abcdef01", "something", 31);  // not ours
    make("a user's folder", "libcuda.so.1", 31);
    const auto run_once = [&] {
        run_scheduled({kPrograms + "/needs_entry_now"}, "old_driver", folder.path() / "cache",
                      folder.path());
    };
    run_once();
    CHECK_FALSE(fs::exists(cache / "0123456789abcdef"));
    CHECK(fs::exists(cache / "123456789abcdef0" / "libcuda.so.1"));
    CHECK(fs::exists(cache / "23456789abcdef01" / "something"));
    CHECK(fs::exists(cache / "a user's folder" / "libcuda.so.1"));
    CHECK(std::distance(fs::directory_iterator(cache), {}) == 4);

    // One that is used stays, however old it is.
    for (const auto& entry : fs::directory_iterator(cache))
        fs::last_write_time(entry.path(), now - std::chrono::hours(24 * 31));
    run_once();
    CHECK(std::distance(fs::directory_iterator(cache), {}) == 4);
    const auto used = [&](const fs::directory_entry& entry) {
        return now - fs::last_write_time(entry.path()) < std::chrono::hours(1);
    };
    CHECK(std::count_if(fs::directory_iterator(cache), {}, used) == 1);
}

TEST_CASE("Program is started with all names when the cache cannot be written",
          "[interposer][missing]") {
    const Folder folder;
    const fs::path file = folder.path() / "file";
    write_text(file, "");
    const Outcome outcome =
        run_scheduled({kPrograms + "/needs_entry_now"}, "old_driver", file, folder.path(), false);
    CHECK(outcome.exit_status == 0);
    const std::string said = "urgengo: warning: " + (file / "urgengo").string();
    const auto lines = lines_of(outcome.err);
    CHECK(std::count_if(lines.begin(), lines.end(),
                        [&](const std::string& line) { return line.rfind(said, 0) == 0; }) == 1);
}

TEST_CASE("Calls are forwarded whole when they are of OpenGL, EGL, VDPAU and the profiler",
          "[interposer][exports]") {
    std::vector<std::string> arguments{kPrograms + "/ask_loader", "call"};
    for (const char* list : {"driver_580.159.04.txt", "headers_13.0.txt"})
        for (const std::string& name :
             lines_of(read_text(fs::path(SOURCE_FOLDER "/tools/codegen/exports") / list)))
            for (const char* part : {"GL", "EGL", "Egl", "VDPAU", "cuProfiler"})
                if (name.front() == 'c' && name.find(part) != std::string::npos &&
                    arguments.back() != name)
                    arguments.push_back(name);
    REQUIRE(arguments.size() > 39);
    const Outcome expected = run(arguments, with_driver(bare(), "stub_driver"));
    CHECK(expected.exit_status == 0);
    CHECK(lines_of(expected.out).size() == 2 * (arguments.size() - 2));
    CHECK(expected.out.find("not found") == std::string::npos);
    check_equal(run(arguments, with_driver(preloaded(), "stub_driver")), expected);
    check_equal(run(arguments, with_driver(by_library_path(), "stub_driver")), expected);
}
#if !SANITIZED
TEST_CASE("Every recorded request is answered alike when UrgenGo stands before the driver",
          "[interposer][proc_address]") {
    if (std::string(PYTHON_PATH).empty()) {
        WARN("no Python 3: not tested");
        return;
    }
    const std::string record = SOURCE_FOLDER "/tests/interposer/data/driver_580.159.04.answers.txt";
    const std::vector<std::string> arguments{
        PYTHON_PATH, SOURCE_FOLDER "/tools/codegen/record_driver.py", "--compare", record};
    for (Environment environment : {bare(), preloaded(), by_library_path()}) {
        environment = with_driver(environment, "recorded_driver");
        environment["STUB_RECORD"] = record;
        const Outcome outcome = run(arguments, environment);
        INFO(outcome.out << outcome.err);
        CHECK(outcome.exit_status == 0);
        CHECK(outcome.err.empty());
    }
}
#endif
