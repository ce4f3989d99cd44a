// SPDX-License-Identifier: Apache-2.0
//
// What is recorded of a run, from end to end: nothing is changed by it, what a killed program
// leaves is readable, and a hold is behind the chain that it is behind.
#include <map>
#include <set>

#include "tests/interposer/check_twin.h"
#include "tests/interposer/on_terminal.h"
#include "tests/interposer/steered.h"
#include "tools/trace/run_story.h"
#include "tools/trace/run_summary.h"

using namespace urgengo;
using namespace urgengo::testing;
using nlohmann::json;

namespace {

trace::Run read(const std::string& path) {
    auto run = trace::read_run(path);
    INFO((run ? std::string() : run.error()));
    REQUIRE(run);
    CHECK(run->warnings == std::vector<std::string>{});
    return std::move(*run);
}

Environment beside(const std::string& folder) {
    return {{"PATH", "/usr/bin:/bin"}, {"URGENGO_SHARE", folder}};
}

bool is_held(const Folder& folder) {
    const auto pages = observe::list_pages(folder.path().string());
    if (pages.size() != 1) return false;
    const auto page = cli::read_page(pages[0], monotonic_now());
    return page && page->held_now == 1;
}

void wait_until_held(const Folder& folder) {
    const nanoseconds end = monotonic_now() + kLongest;
    while (!is_held(folder) && monotonic_now() < end) std::this_thread::sleep_for(1ms);
    REQUIRE(is_held(folder));
}

void check_hold(const trace::Run& run) {
    const trace::RunStory story = trace::tell(run);
    const trace::RunSlice* held = nullptr;
    for (const trace::RunSlice& slice : story.slices)
        if (slice.kind == trace::RunSlice::Kind::kHold) held = &slice;
    REQUIRE(held);
    CHECK(held->is_open);
    CHECK(trace::task_name(run, held->task) == "loose/work");
    CHECK(trace::hold_words(run, *held) == "held behind tight");
    CHECK(held->why == abi::Why::kRank);
}

}  // namespace

TEST_CASE("Results are the same when the run is recorded", "[interposer][records]") {
    const MemoryFolder folder;
    const std::string name = folder.path("run-%p.ugtrace");
    check_twin({.name = "streams", .environment = {{"URGENGO_RUN_TRACE", name}}});
    std::size_t traces = 0, records = 0;
    for (const auto& entry : std::filesystem::directory_iterator(folder.path())) {
        ++traces;
        records += read(entry.path().string()).records.size();
    }
    CHECK(traces > 0);
    CHECK(records > 0);
}

TEST_CASE("Program that hangs in a hold is dumped, and the hold is behind the right chain",
          "[interposer][records]") {
    const MemoryFolder folder;
    Running program({TWIN_PATH, "hangs"}, held_for_ever(folder));
    wait_until_held(folder);
    const std::string file = folder.path("hang.ugtrace");
    const bool is_killed = GENERATE(false, true);
    if (is_killed) {
        REQUIRE(kill(program.process(), SIGKILL) == 0);
        program.wait();
    }
    const Outcome outcome =
        run({URGENGO_PATH, "ctl", "dump", "-o", file, "--json"}, beside(folder.path().string()));
    CHECK(outcome.err == "");
    REQUIRE(outcome.exit_status == 0);
    CHECK(json::parse(outcome.out).at("records") > 0);
    check_hold(read(file));
    const Outcome why =
        run({URGENGO_PATH, "trace", "why", file, "--chain", "loose", "--frame", "1"},
            beside(folder.path().string()));
    CHECK(why.exit_status == 0);
    CHECK(why.out.find("held behind tight") != std::string::npos);
    if (is_killed) {
        // By the next one that looks.
        CHECK(cli::find_pages(folder.path().string()).empty());
        CHECK(run({URGENGO_PATH, "ctl", "dump", "-o", file}, beside(folder.path().string()))
                  .exit_status == 1);
        for (const auto& entry : std::filesystem::directory_iterator(folder.path()))
            CHECK(entry.path().extension() != observe::kRecordsSuffix);
    } else {
        REQUIRE(kill(program.process(), SIGKILL) == 0);
        program.wait();
    }
}

TEST_CASE("Killed program leaves a trace that can be read", "[interposer][records]") {
    const MemoryFolder folder;
    Environment environment = held_for_ever(folder);
    const std::string file = folder.path("run.ugtrace");
    environment["URGENGO_RUN_TRACE"] = file;
    Running program({TWIN_PATH, "hangs"}, environment);
    wait_until_held(folder);
    const Outcome none =
        run({URGENGO_PATH, "ctl", "dump", "-o", file + "2"}, beside(folder.path().string()));
    CHECK(none.exit_status == 1);
    CHECK(none.err.find("has no flight recorder") != std::string::npos);
    REQUIRE(kill(program.process(), SIGKILL) == 0);
    program.wait();
    check_hold(read(file));
}

TEST_CASE("Dump is written when a chain misses its deadline, and tells which frame and why",
          "[interposer][records]") {
    const Steered program(config::Mode::kEnforce, 2ms);  // which is too short
    program.wait_for_frames(20);
    const std::string file = program.folder() + "/miss.ugtrace";
    const Outcome outcome = run(
        {URGENGO_PATH, "ctl", "dump", "--on-miss", "--after", "0.1", "--files", "2", "-o", file},
        beside(program.folder()));
    CHECK(outcome.err == "");
    REQUIRE(outcome.exit_status == 0);
    CHECK(outcome.out.find("missed its deadline") != std::string::npos);
    const std::string second = program.folder() + "/miss-2.ugtrace";
    const trace::Run run_of = read(second);
    CHECK(run_of.copied_ns > 0);
    const trace::RunStory story = trace::tell(run_of);
    CHECK_FALSE(trace::late_frames(story).empty());
    const Outcome info = run({URGENGO_PATH, "trace", "info", second, "--json"}, {});
    REQUIRE(info.exit_status == 0);
    const json told = json::parse(info.out);
    CHECK(told.at("program") == "twin");
    REQUIRE(told.at("chains").size() == 4);
    const json& late = told.at("late").back();
    const Outcome why =
        run({URGENGO_PATH, "trace", "why", second, "--chain", late.at("chain").get<std::string>(),
             "--frame", std::to_string(late.at("frame").get<int>()), "--json"},
            {});
    REQUIRE(why.exit_status == 0);
    CHECK(json::parse(why.out).at("cause") == late.at("cause"));
    for (const char* format : {"--perfetto", "--chrome", "--csv"}) {
        const std::string to = second + format;
        CHECK(run({URGENGO_PATH, "trace", "export", second, format, "-o", to}, {}).exit_status ==
              0);
        CHECK(std::filesystem::file_size(to) > 1000);
    }
    CHECK(run_of.gpu.find("Simulated") != std::string::npos);
    const json conditions = json::parse(run_of.conditions);
    CHECK(conditions.at("command").get<std::string>().find("steered") != std::string::npos);
    CHECK(conditions.at("config").at("chains").size() == 4);
    CHECK_FALSE(conditions.at("kernels").at("names").empty());
    CHECK(conditions.at("kernels").at("launches").size() == run_of.tasks.size());
    // Each task's launches are on a stream of its own.
    std::map<std::string, std::set<std::string>> streams;
    for (const std::string& line : lines_of(read_text(second + "--csv"))) {
        if (!line.starts_with("gpu_launches,")) continue;
        const std::string chain = line.substr(13, line.find(',', 13) - 13);
        streams[chain].insert(line.substr(line.rfind(',') + 1));
    }
    CHECK(streams.size() > 1);
    std::set<std::string> all;
    for (const auto& [chain, its] : streams) {
        INFO(chain);
        CHECK(its.size() == 1);
        CHECK(its.count("") == 0);
        all.insert(its.begin(), its.end());
    }
    CHECK(all.size() == streams.size());
    CHECK(read_text(second + "--perfetto").find("streams") != std::string::npos);
}

TEST_CASE("urgengo report tells of runs side by side, and writes a page", "[interposer][records]") {
    Steered program(config::Mode::kEnforce, 2ms);  // which is too short
    program.wait_for_frames(20);
    std::vector<std::string> files;
    for (const char* const name : {"/a.ugtrace", "/b.ugtrace"}) {
        files.push_back(program.folder() + name);
        REQUIRE(run({URGENGO_PATH, "ctl", "dump", "-o", files.back()}, beside(program.folder()))
                    .exit_status == 0);
        program.wait_for_frames(20);
    }
    const std::string page = program.folder() + "/report.html";
    const auto report = [&](std::vector<std::string> arguments) {
        arguments.insert(arguments.begin(), {URGENGO_PATH, "report"});
        return run(arguments, {});
    };
    const Outcome text = report({files[0], files[1], "-o", page});
    CHECK(text.err == "");
    REQUIRE(text.exit_status == 0);
    CHECK(text.out.find("steered_0") != std::string::npos);
    CHECK(std::filesystem::file_size(page) > 200'000);  // with its charts
    CHECK(report({files[0], "-o", page, "--quiet"}).out == "");
    const Outcome told = report({files[0], files[1], "--json"});
    REQUIRE(told.exit_status == 0);
    const json runs = json::parse(told.out).at("runs");
    REQUIRE(runs.size() == 2);
    CHECK(runs[0].at("label") == "a");
    CHECK(runs[1].at("is_simulated") == true);
    CHECK(runs[0].at("missed").at("pct") > 0);
    const Outcome csv = report({files[0], "--csv"});
    CHECK(std::count(csv.out.begin(), csv.out.end(), '\n') == 5);

    CHECK(report({program.folder() + "/none"}).exit_status == 1);
    CHECK(report({program.folder() + "/none"}).err.find("cannot be read") != std::string::npos);
    CHECK(report({}).exit_status == 2);
    CHECK(report({files[0], "--json", "--csv"}).exit_status == 2);
    const Outcome nowhere = report({files[0], "-o", "/nonexistent/report.html"});
    CHECK(nowhere.exit_status == 1);
    CHECK(nowhere.out == "");
    check_results(program.end());
}

TEST_CASE(
    "Command that takes long says on a terminal for how long it has, unless it is to be quiet",
    "[interposer][progress]") {
    const Steered program(config::Mode::kEnforce, 60s);  // no frame misses that
    const Environment environment = beside(program.folder());
    const std::vector<std::string> command = {"ctl", "dump", "--on-miss", "-o",
                                              program.folder() + "/never.ugtrace"};
    OnTerminal dump(command, environment);
    auto silent = command;
    silent.push_back("--quiet");
    OnTerminal quiet(silent, environment);
    CHECK(dump.shows("waiting for miss 1 of 1 of process "));
    dump.signal(SIGINT);
    quiet.signal(SIGINT);
    CHECK(dump.wait() == 128 + SIGINT);
    CHECK(quiet.wait() == 128 + SIGINT);
    CHECK(quiet.shown() == "");
}

TEST_CASE("urgengo trace says what is wrong", "[interposer][records]") {
    const MemoryFolder folder;
    const std::string file = folder.path("no.ugtrace");
    write_text(file, "this is no trace");
    const auto trace = [&](std::vector<std::string> arguments) {
        arguments.insert(arguments.begin(), {URGENGO_PATH, "trace"});
        return run(arguments, {});
    };
    CHECK(trace({"info", file}).err ==
          "urgengo: " + file + ": found 16 bytes, accepted: a run's records (at least 320)\n");
    CHECK(trace({"info", file}).exit_status == 1);
    CHECK(trace({"draw", file}).exit_status == 2);
    CHECK(trace({"info"}).exit_status == 2);
}
