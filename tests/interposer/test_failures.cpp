// SPDX-License-Identifier: Apache-2.0
//
// The driver fails, by injection (SIMGPU_FAIL): in calls of the program, which must reach it
// unchanged, and in every call that UrgenGo adds, which must reach nobody. Either way the program
// does what it does without UrgenGo, and nothing stays held or changed.
#include <nlohmann/json.hpp>

#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
using nlohmann::json;

namespace {

Environment failing(Environment environment, const std::string& failures) {
    if (!failures.empty()) environment["SIMGPU_FAIL"] = failures;
    return environment;
}

struct Sums {
    int launches = 0, scheduled = 0, marks = 0, marks_refused = 0, holds = 0;
};

struct FailedRun {
    Outcome outcome;
    Sums sums;
    std::string tripped;
};

/// Runs the scenario under UrgenGo. The main thread's long kernels are known: others are held.
FailedRun run_failing(const std::string& failures, config::Mode mode,
                      config::ProgressSource source = config::ProgressSource::kAuto) {
    const Folder folder;
    const auto stats = folder.path() / "stats.json";
    config::TaskProfile known;
    known.name = "main";
    known.kernels = {{"very_long", 46, 1024, 50ms, 1.0}};
    config::Profile profile;
    profile.chains = {{"main", {known}}};
    const auto config = write_config(
        folder.path() / "config.json", "urgengo", mode,
        {chain("main", 400ms, {{"main", "twin"}}), chain("worker", 3s, {{"work", "twin_*"}})},
        &profile, [source](config::Config& c) { c.scheduler.progress.source = source; });
    FailedRun run;
    run.outcome = run_twin({"failures"}, failing(configured(preloaded(), config, stats), failures));
    const json root = json::parse(read_text(stats), nullptr, false);
    REQUIRE(!root.is_discarded());
    run.tripped = root.at("tripped");
    for (const json& one : root.at("chains")) {
        run.sums.launches += one.at("launches").get<int>();
        run.sums.scheduled += one.at("scheduled").get<int>();
        run.sums.marks += one.at("marks").get<int>();
        run.sums.marks_refused += one.at("marks_refused").get<int>();
        run.sums.holds += one.at("holds").get<int>();
    }
    return run;
}

/// UrgenGo says at most one line, and that one as its own.
void check_quiet(const Outcome& outcome) {
    INFO("stderr: " << outcome.err);
    auto lines = lines_of(outcome.err);
    std::erase_if(lines,
                  [](const std::string& l) { return l.rfind("urgengo: warning: ", 0) == 0; });
    CHECK(lines.size() <= 1);
    for (const std::string& line : lines) CHECK(line.rfind("urgengo: ", 0) == 0);
}

/// As run_failing(), compared with a bare run in which the driver fails as `bare_failures` says.
FailedRun check_failing(const std::string& failures, const std::string& bare_failures,
                        config::Mode mode = config::Mode::kEnforce,
                        config::ProgressSource source = config::ProgressSource::kAuto) {
    INFO("SIMGPU_FAIL=" << failures);
    const Outcome alone = run_twin({"failures"}, failing(bare(), bare_failures));
    REQUIRE(alone.exit_status == 0);
    REQUIRE(alone.err == "");
    FailedRun run = run_failing(failures, mode, source);
    CHECK(run.outcome.exit_status == 0);
    const auto a = lines_of(run.outcome.out), b = lines_of(alone.out);
    for (std::size_t i = 0; i < std::max(a.size(), b.size()); ++i) {
        const std::string found = i < a.size() ? a[i] : "(none)";
        const std::string wanted = i < b.size() ? b[i] : "(none)";
        INFO("line " << i + 1);
        CHECK(found == wanted);
        if (found != wanted) break;
    }
    check_quiet(run.outcome);
    return run;
}

bool says(const std::string& out, const std::string& text) {
    return out.find(text) != std::string::npos;
}

}  // namespace

TEST_CASE("Program's failing launch has its own result when UrgenGo carries it",
          "[interposer][failures]") {
    // The fourth is in the middle of work of several streams; 700 and 719 break the context.
    const std::string failure =
        GENERATE("kernel:frail:1:1", "kernel:frail:2:2", "kernel:frail:4:701", "kernel:frail:3:801",
                 "kernel:frail:1:700", "kernel:frail:4:719", "kernel:urgengo_mark:999:1");
    const auto mode = GENERATE(config::Mode::kObserve, config::Mode::kEnforce);
    const FailedRun run = check_failing(failure, failure, mode);
    const std::string code = failure.substr(failure.rfind(':') + 1);
    if (code != "1" || failure == "kernel:frail:1:1")
        CHECK(says(run.outcome.out, "launch_tiny(p.frail, stream) = " + code + ","));
    CHECK(run.tripped == "");
    CHECK(run.sums.launches > 0);
    CHECK((run.sums.scheduled > 0) == (mode == config::Mode::kEnforce));
}

TEST_CASE("Program hears of its faulty kernel as usual when marks follow it",
          "[interposer][failures]") {
    const std::string failure = GENERATE("fault:frail:1:700", "fault:frail:3:719");
    const FailedRun run = check_failing(failure, failure);
    const std::string code = failure.substr(failure.rfind(':') + 1);
    CHECK(says(run.outcome.out, "cuStreamSynchronize(stream) = " + code + ","));
    CHECK(run.tripped == "");
}

TEST_CASE("Program notices nothing when a mark of UrgenGo's is refused", "[interposer][failures]") {
    const std::string failure =
        GENERATE("kernel:urgengo_mark:1:2", "kernel:urgengo_mark:2:1", "kernel:urgengo_mark:3:701",
                 "kernel:urgengo_mark:1:801,kernel:urgengo_mark:2:801");
    const FailedRun run = check_failing(failure, "");
    CHECK(run.sums.marks_refused > 0);
    CHECK(run.tripped == "");
    CHECK(run.sums.launches > 0);
}

TEST_CASE("Program notices nothing when a source of progress is refused and kernels mark instead",
          "[interposer][failures]") {
    using config::ProgressSource;
    // The program calls none of these itself. A mark kernel that is refused shows that there was
    // one: without a failure before it there is none.
    const std::string kernel = ",kernel:urgengo_mark:1:2";
    const auto [source, failure] = GENERATE(table<ProgressSource, std::string>({
        {ProgressSource::kMemop, ""},
        {ProgressSource::kMemop, "cuStreamBatchMemOp_v2:1:801"},
        {ProgressSource::kMemop, "cuStreamBatchMemOp_v2:2:1"},
        {ProgressSource::kEvent, ""},
        {ProgressSource::kEvent, "cuEventCreate:1:2"},
        {ProgressSource::kEvent, "cuEventRecord:1:801"},
        {ProgressSource::kEvent, "cuEventRecord:2:400"},
        {ProgressSource::kEvent, "cuEventQuery:1:999"},
    }));
    const FailedRun run = check_failing(failure.empty() ? kernel.substr(1) : failure + kernel, "",
                                        config::Mode::kEnforce, source);
    CHECK(run.sums.marks > 0);
    CHECK((run.sums.marks_refused > 0) == !failure.empty());
    CHECK(run.tripped == "");
}

TEST_CASE("Program is left alone when UrgenGo's own set-up fails", "[interposer][failures]") {
    // Numbers after those of the program's own calls; both for an error that says "not possible"
    // and for want of memory.
    const std::string failure = GENERATE("cuMemHostRegister_v2:1:2", "cuMemHostRegister_v2:1:801",
                                         "cuMemHostGetDevicePointer_v2:1:1", "cuModuleLoadData:2:2",
                                         "cuModuleLoadData:2:209", "cuModuleGetFunction:7:500",
                                         "cuCtxGetStreamPriorityRange:1:1", "cuCtxGetDevice:1:201",
                                         "cuDeviceGetAttribute:1:1", "cuDeviceGetAttribute:2:1");
    const FailedRun run = check_failing(failure, "");
    CHECK(run.sums.launches > 0);
    // What follows the reset is another context, in which the set-up succeeds.
    const FailedRun unharmed = run_failing("", config::Mode::kEnforce);
    CHECK(run.sums.scheduled < unharmed.sums.scheduled);
    CHECK(run.sums.holds == 0);
}

TEST_CASE("Program notices nothing when one of UrgenGo's questions fails",
          "[interposer][failures]") {
    const std::string failure = GENERATE(
        "cuCtxGetId:1:201", "cuCtxGetId:5:201", "cuCtxGetCurrent:1:3", "cuCtxGetCurrent:4:3",
        "cuFuncGetName:1:1", "cuFuncGetName:2:98", "cuThreadExchangeStreamCaptureMode:1:1",
        "cuThreadExchangeStreamCaptureMode:2:1", "cuStreamIsCapturing:1:1",
        "cuStreamIsCapturing:2:906", "cuStreamSetAttribute:1:1", "cuStreamSetAttribute:2:1",
        "cuStreamSetAttribute:3:1", "cuModuleGetFunction:8:500");
    const FailedRun run = check_failing(failure, "");
    CHECK(run.sums.launches > 0);
}
