// SPDX-License-Identifier: Apache-2.0
//
// urgengo profile on a trace that is there: what is written, merged, printed and refused; and how
// the program that it runs is ended.
#include "tools/urgengo/cmd_profile.h"

#include <filesystem>

#include "host/config/config_reader.h"
#include "host/config/profile_reader.h"
#include "tests/support/catch.h"
#include "tests/support/folder.h"
#include "tests/support/trace_builder.h"
#include "tools/trace/profile_builder.h"
#include "tools/urgengo/command_json.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/profile_table.h"
#include "tools/urgengo/program/run_process.h"
#include "tools/urgengo/progress_bar.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;
using testing::Folder;
using testing::TraceBuilder;
using testing::TracedThread;

std::string yaml(const std::string& thread) {
    return "version: 1\nchains: [{name: C0, period_ms: 20, deadline_ms: 20, tasks: "
           "[{name: detect, thread: \"" +
           thread + "\"}]}]\n";
}

std::string trace_of(int frames, const std::string& gpu = "Test GPU") {
    TraceBuilder builder;
    std::strcpy(builder.header.gpu, gpu.c_str());
    TracedThread thread(builder, 3, "det_0");
    for (int i = 0; i < frames; ++i) {
        thread.sleep_until((i + 1) * 20'000'000);
        thread.compute(100'000);
        for (int k = 0; k < 3; ++k) thread.launch({"conv", 8, 64, 250'000, 0.5});
        thread.wait();
    }
    return builder.bytes();
}

TEST_CASE("profile writes what a trace teaches beside the config", "[unit][cli]") {
    const Folder folder;
    ProfileOptions options;
    options.config = folder.write("chains.yaml", yaml("det_*"));
    options.trace = folder.write("a.ugtrace", trace_of(20));
    REQUIRE(cmd_profile(options, {"/opt/my_stack", "--fast"}) == 0);
    const auto profile = config::read_profile(folder.path("chains.profile.json"));
    REQUIRE(profile);
    CHECK(profile->program == "my_stack");
    CHECK(profile->gpu == "Test GPU");
    const auto& task = profile->chains.at(0).tasks.at(0);
    CHECK(task.instances == 20);
    CHECK(task.kernels.size() == 3);
    CHECK(task.kernels[0].gpu_time == std::chrono::microseconds(250));
}

TEST_CASE("profile's JSON tells what was learned of each task", "[unit][cli]") {
    const auto learned = [](const std::string& thread) {
        const Folder folder;
        const auto trace = trace::read_trace(folder.write("a.ugtrace", trace_of(20)));
        REQUIRE(trace);
        const auto config = config::read_config(folder.write("chains.yaml", yaml(thread)));
        REQUIRE(config);
        return trace::learn_profile(*trace, *config, "stack", nullptr);
    };
    const auto json = profile_json("chains.profile.json", learned("det_*"));
    CHECK(json.at("format_version") == 1);
    CHECK(json.at("profile") == "chains.profile.json");
    CHECK(json.at("program") == "stack");
    CHECK(json.at("gpu") == "Test GPU");
    REQUIRE(json.at("tasks").size() == 1);
    const auto& task = json.at("tasks").at(0);
    CHECK(task.at("chain") == "C0");
    CHECK(task.at("task") == "detect");
    CHECK(task.at("instances") == 20);
    CHECK(task.at("launches") == 3);
    CHECK(task.at("segments") == 1);
    CHECK(task.at("busy_ms").get<double>() == Approx(0.75));
    CHECK(task.at("latency_ms").is_null());  // there was no run without timing
    CHECK(task.at("bound").is_null());
    CHECK(task.at("verdict") == "adds_up");
    CHECK(task.at("timed_by") == "marks");
    CHECK(task.at("alone_share") == 1.0);
    const auto none = profile_json("", learned("other"));
    CHECK(none.at("profile").is_null());
    CHECK(none.at("tasks").at(0).at("launches") == 0);
    CHECK_FALSE(none.at("tasks").at(0).contains("busy_ms"));
    CHECK(none.at("warnings").size() == 1);
}

TEST_CASE("Progress is told on one line that can be erased", "[unit][cli]") {
    using std::chrono::seconds;
    CHECK(progress_text(-1, "watching stack", seconds(12)) == "watching stack, 12 s");
    CHECK(progress_text(0.2, "run", seconds(3)) ==
          "[######........................]  20 % run, 3 s");
    CHECK(progress_text(7, "run", seconds(3)) == "[##############################] 100 % run, 3 s");
    for (const double part : {-1.0, 0.5})
        CHECK(progress_text(part, std::string(500, 'x'), seconds(86'400)).size() == 79);
}

TEST_CASE("profile merges only when asked, and not what is of another GPU", "[unit][cli]") {
    const Folder folder;
    ProfileOptions options;
    options.config = folder.write("chains.yaml", yaml("det_*"));
    options.out = folder.path("p.json");
    options.trace = folder.write("a.ugtrace", trace_of(20));
    const auto instances = [&] {
        const auto profile = config::read_profile(options.out);
        return profile ? profile->chains.at(0).tasks.at(0).instances : 0;
    };
    REQUIRE(cmd_profile(options, {}) == 0);
    REQUIRE(cmd_profile(options, {}) == 0);
    CHECK(instances() == 20);
    options.merge = true;
    REQUIRE(cmd_profile(options, {}) == 0);
    CHECK(instances() == 40);
    options.trace = folder.write("b.ugtrace", trace_of(20, "Other GPU"));
    CHECK(cmd_profile(options, {}) == kExitFailure);
    CHECK(instances() == 40);
}

TEST_CASE("profile writes nothing when nothing was learned", "[unit][cli]") {
    const Folder folder;
    ProfileOptions options;
    options.config = folder.write("chains.yaml", yaml("other"));
    options.trace = folder.write("a.ugtrace", trace_of(20));
    CHECK(cmd_profile(options, {}) == kExitFailure);
    CHECK_FALSE(fs::exists(folder.path("chains.profile.json")));
    options.trace = folder.write("b.ugtrace", "no trace");
    CHECK(cmd_profile(options, {}) == kExitFailure);
}

TEST_CASE("profile refuses options that contradict each other", "[unit][cli]") {
    const Folder folder;
    ProfileOptions options;
    options.config = folder.write("chains.yaml", yaml("det_*"));
    CHECK(cmd_profile(options, {}) == kExitUsage);  // neither a program nor a trace
    options.isolated = options.in_situ = true;
    CHECK(cmd_profile(options, {"true"}) == kExitUsage);
    options = {};
    options.config = folder.write("chains.yaml", yaml("det_*"));
    options.trace = folder.write("a.ugtrace", trace_of(9));
    options.seconds = 3;
    CHECK(cmd_profile(options, {}) == kExitUsage);
    options.seconds = 0;
    options.out = "/nonexistent/p.json";
    CHECK(cmd_profile(options, {}) == kExitUsage);
    options.out = "";
    options.config = "/nonexistent/chains.yaml";
    CHECK(cmd_profile(options, {}) == kExitUsage);
}

TEST_CASE("profile's table has a row for each task, found or not", "[unit][cli]") {
    TraceBuilder builder;
    TracedThread thread(builder, 3, "det_0");
    for (int i = 0; i < 10; ++i) {
        thread.sleep(20'000'000);
        thread.launch({std::string(50, 'k'), 8, 64, 250'000, 0.5});
        thread.wait(abi::TraceWait::kEvent);
    }
    const auto trace = trace::parse_trace(builder.bytes(), "a");
    REQUIRE(trace);
    config::Config config;
    config.chains.push_back({"C0",
                             std::chrono::milliseconds(20),
                             std::chrono::milliseconds(20),
                             {},
                             {{"detect", "det_*"}, {"track", "t_*"}}});
    const std::string table = profile_table(trace::learn_profile(*trace, config, ""));
    CHECK(table.find("C0/detect         10  1  1    0.250   0.250           -") !=
          std::string::npos);
    CHECK(table.find(std::string(30, 'k') + "..@8x64") != std::string::npos);
    CHECK(table.find("event") != std::string::npos);
    CHECK(table.find("C0/track           0  -  -") != std::string::npos);
}

TEST_CASE("A program is ended when its time is over, gently first", "[unit][cli]") {
    ProcessOptions options;
    options.limit = std::chrono::milliseconds(300);
    const auto heeds = run_process({"/bin/sh", "-c",
                                    "trap 'echo ended; exit 7' INT; sleep 5 & "
                                    "wait $!"},
                                   current_environment(), options);
    REQUIRE(heeds);
    CHECK(heeds->timed_out);
    CHECK_FALSE(heeds->interrupted);
    CHECK(heeds->exit_code == 7);
    CHECK(heeds->output == "ended\n");
    options.grace = std::chrono::seconds(1);
    const auto ignores = run_process({"/bin/sh", "-c", "trap '' INT; exec sleep 60"},
                                     current_environment(), options);
    REQUIRE(ignores);
    CHECK(ignores->timed_out);
    CHECK(ignores->exit_code == 128 + 9);
    const auto quick = run_process({"/bin/true"}, current_environment(), options);
    REQUIRE(quick);
    CHECK_FALSE(quick->timed_out);
}

}  // namespace
}  // namespace urgengo::cli
