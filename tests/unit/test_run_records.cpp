// SPDX-License-Identifier: Apache-2.0
//
// What the runtime writes down of a run, in virtual time.
#include "host/runtime/run_records.h"

#include <algorithm>
#include <set>

#include "tests/support/folder.h"
#include "tests/support/runtime_fixture.h"
#include "tools/trace/run_story.h"
#include "tools/trace/run_summary.h"
#include "tools/trace/run_timeline.h"

using namespace urgengo;
using namespace urgengo::testing;
using abi::RunKind;

namespace {

struct Recorded : RuntimeFixture {
    MemoryFolder folder;

    /// @param trace  else the flight recorder
    explicit Recorded(bool trace = true) {
        close_segments();
        const std::string folder_path = folder.path().string();
        runtime = std::make_unique<Runtime>(
            resolved, driver.api, clock, runtime::TraceOptions{}, 0,
            trace ? observe::ShareOptions{} : observe::ShareOptions{folder_path, ""},
            observe::RecordOptions{trace ? folder.path("run.ugtrace") : "", 128, ""});
    }
    trace::Run read(const std::string& path) {
        auto run = trace::read_run(path);
        REQUIRE(run);
        return std::move(*run);
    }
    trace::Run read() { return read(folder.path("run.ugtrace")); }

    /// `loose` is held behind `tight` for a while.
    void hold() {
        begin(thread_b, "loose");
        launch(thread_b, kStreamB);
        begin(thread_a, "tight");
        launch(thread_a);
        wait_a();
        clock.advance(1ms);
        clock.on_sleep = [this] {
            if (clock.num_sleeps == 4) driver.execute_marks(1);
        };
        launch(thread_b, kStreamB);
    }
};

}  // namespace

TEST_CASE("Records tell behind which chain a launch was held, and for how long",
          "[runtime][records]") {
    Recorded f;
    f.hold();
    CHECK(f.rt().observers().records.note() == "");
    const trace::Run run = f.read();
    CHECK(run.warnings.empty());
    const trace::RunStory story = trace::tell(run);
    const auto chains = trace::summarize(run, story);
    REQUIRE(chains.size() == 2);
    CHECK(chains[0].holds == 0);
    CHECK(chains[1].holds == 1);
    CHECK(chains[1].held_ns == f.stats(1).tasks.held_ns);
    // By which the held launch has seen that it may go.
    const auto is_mark = [](const trace::RunRecord& r) {
        return r.kind == RunKind::kMark && r.task == 0 && r.mark.position == 1;
    };
    CHECK(std::count_if(run.records.begin(), run.records.end(), is_mark) == 1);
    for (const trace::RunSlice& slice : story.slices) {
        if (slice.kind != trace::RunSlice::Kind::kHold) continue;
        CHECK(slice.task == 1);
        CHECK(slice.behind_task == 0);
        CHECK(slice.behind_chain == 0);
        CHECK(slice.why == abi::Why::kRank);
        CHECK_FALSE(slice.is_open);
        REQUIRE(slice.frame != trace::kNoFrame);
        CHECK(trace::frame_name(run, story.frames[slice.frame]) == "loose #1");
        CHECK(trace::hold_words(run, slice) == "held behind tight");
    }
}

TEST_CASE("Records tell on which stream marks and segments are, and what the GPU's clock is",
          "[runtime][records]") {
    Recorded f;
    f.hold();
    std::map<int, std::set<std::uint16_t>> segments, marks;
    int clocks = 0;
    for (const trace::RunRecord& record : f.read().records) {
        if (record.kind == RunKind::kSegmentBegin || record.kind == RunKind::kSegmentEnd)
            segments[record.task].insert(record.stream);
        if (record.kind == RunKind::kMark) marks[record.task].insert(record.stream);
        if (record.kind != RunKind::kClock) continue;
        ++clocks;
        CHECK(record.clock.host_ns > 0);
        CHECK(record.clock.host_ns <= record.time_ns);
    }
    const std::uint16_t first = abi::kRunLegacyStream + 1;  // `loose` launches first
    CHECK(segments[1] == std::set<std::uint16_t>{first});
    CHECK(segments[0] == std::set<std::uint16_t>{first + 1});
    CHECK(marks[0] == std::set<std::uint16_t>{first + 1});
    CHECK(clocks == 1);  // all of it takes less than a second
}

TEST_CASE("Streams are numbered in the order in which they are asked for, as many as there is room",
          "[runtime][records]") {
    runtime::StreamNumbers numbers;
    CHECK(numbers.number_of(0) == 0);
    CHECK(numbers.number_of(0x500) == abi::kRunLegacyStream + 1);
    CHECK(numbers.number_of(identity::stream_id(CU_STREAM_LEGACY, exec::StreamFlavor::kLegacy)) ==
          abi::kRunLegacyStream);
    std::set<std::uint16_t> seen;
    for (progress::StreamId id = 0x1000; id < 0x1000 + runtime::StreamNumbers::kMost; ++id)
        seen.insert(numbers.number_of(id));
    CHECK(seen.count(0) == 1);
    CHECK(seen.size() == runtime::StreamNumbers::kMost - 2 + 1);
    CHECK(numbers.number_of(0x500) == abi::kRunLegacyStream + 1);
}

TEST_CASE("Records tell of frames, tasks, segments, waits, marks and priorities",
          "[runtime][records]") {
    Recorded f;
    for (int frame = 0; frame < 3; ++frame) {
        f.begin(f.thread_a, "tight", frame == 2 ? 50ms : 0ms);
        for (int i = 0; i < 4; ++i) f.launch(f.thread_a);
        f.driver.execute_marks(9);
        f.clock.advance(1ms);
        f.launch(f.thread_a);
        f.wait(f.thread_a, kStreamA);
        f.rt().frames().task_end(f.thread_a);
    }
    f.rt().steering().set_mode(config::Mode::kObserve);
    f.rt().trip();
    const trace::Run run = f.read();
    std::map<RunKind, int> counts;
    for (const trace::RunRecord& record : run.records) ++counts[record.kind];
    for (const RunKind kind :
         {RunKind::kFrameBegin, RunKind::kFrameEnd, RunKind::kTaskBegin, RunKind::kTaskEnd,
          RunKind::kSegmentBegin, RunKind::kSegmentEnd, RunKind::kWaitBegin, RunKind::kWaitEnd})
        CHECK(counts[kind] == 3);
    CHECK(counts[RunKind::kPriority] == 1);  // it stayed the same
    CHECK(counts[RunKind::kMode] == 2);
    CHECK(counts[RunKind::kTrip] == 1);
    CHECK(counts[RunKind::kCpuUse] == 1);  // all of it takes less than a second
    const trace::RunStory story = trace::tell(run);
    REQUIRE(story.frames.size() == 3);
    std::multiset<std::uint32_t> late;
    for (const trace::RunFrame& frame : story.frames) {
        CHECK(frame.has_ended);
        CHECK(frame.number > 0);
        if (frame.is_late()) late.insert(frame.number);
    }
    CHECK(late == std::multiset<std::uint32_t>{3});
    for (const trace::RunSlice& slice : story.slices) CHECK(slice.frame != trace::kNoFrame);
}

TEST_CASE("Flight recorder lies beside the status page, and goes with it", "[runtime][records]") {
    std::string path;
    {
        Recorded f(false);
        f.hold();
        path = f.rt().status().stem() + observe::kRecordsSuffix;
        const trace::Run run = f.read(path);
        CHECK(run.keeps == abi::RunKeeps::kNewest);
        CHECK(trace::summarize(run, trace::tell(run))[1].holds == 1);
        f.rt().status().retire();
        CHECK(access(path.c_str(), F_OK) != 0);
    }
}

TEST_CASE("Launches that go at once write nothing down", "[runtime][records]") {
    Recorded f;
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    const std::size_t before = f.read().records.size();
    for (int i = 0; i < 3; ++i) f.launch(f.thread_a);
    CHECK(f.read().records.size() == before);
}

TEST_CASE("Records tell shadow from enforce", "[runtime][records]") {
    Recorded f;
    f.rt().steering().set_mode(config::Mode::kShadow);
    f.rt().steering().set_mode(config::Mode::kEnforce);
    std::vector<abi::StatusMode> modes;
    for (const trace::RunRecord& record : f.read().records)
        if (record.kind == RunKind::kMode) modes.push_back(record.mode);
    CHECK(modes == std::vector{abi::StatusMode::kShadow, abi::StatusMode::kEnforce});
}

TEST_CASE("Records of a program in which UrgenGo has tripped are there after its end",
          "[runtime][records]") {
    Recorded f(false);
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    const std::string stem = f.rt().status().stem();
    const std::string records = stem + observe::kRecordsSuffix;
    CHECK(f.rt().observers().records.path() == records);
    const bool trips = GENERATE(true, false);
    if (trips) {
        f.rt().trip();
        // What follows is counted, and overwrites nothing of what was before.
        for (std::uint32_t i = 0; i < 2 * observe::kFlightRecords; ++i) {
            f.begin(f.thread_b, "loose");
            f.rt().frames().task_end(f.thread_b);
        }
        CHECK(f.stats(1).frames.finished == 2 * observe::kFlightRecords);
    }
    f.runtime.reset();
    CHECK(std::filesystem::exists(records) == trips);
    CHECK(std::filesystem::exists(stem + observe::kPageSuffix) == trips);
    CHECK_FALSE(std::filesystem::exists(stem + observe::kControlSuffix));
    if (!trips) return;
    CHECK(observe::remove_stale_pages(f.folder.path().string()) == 0);
    const trace::Run run = f.read(records);
    REQUIRE(run.records.size() > 2);
    CHECK(run.records.front().kind == RunKind::kFrameBegin);
    CHECK(run.records.back().kind == RunKind::kTrip);
}

TEST_CASE("Records tell what one chain is steered to, what the guard gives it, and of reloads",
          "[runtime][records]") {
    Recorded f;
    const runtime::Steering::Request request{
        abi::next_control_word(0, abi::ControlCommand::kChainObserve), 1};
    f.rt().steering().obey({&request, 1});
    // `tight` is late if it is scheduled, and only then.
    for (int i = 0; i < 200 && f.rt().guard().enforces(0); ++i) {
        f.clock.advance(100ms);
        f.begin(f.thread_b, "loose", 10ms);
        f.rt().frames().task_end(f.thread_b);
        f.begin(f.thread_a, "tight");
        f.clock.advance(f.rt().guard().enforces(0) ? 30ms : 10ms);
        f.rt().frames().task_end(f.thread_a);
    }
    CHECK_FALSE(f.rt().guard().enforces(0));
    const trace::Run run = f.read();
    const trace::RunStory story = trace::tell(run);
    const auto find = [&](RunKind kind) {
        return std::find_if(story.points.begin(), story.points.end(),
                            [&](const auto& record) { return record.kind == kind; });
    };
    const auto steered = find(RunKind::kChainMode), guarded = find(RunKind::kGuard);
    REQUIRE(steered != story.points.end());
    CHECK(steered->chain == 1);
    CHECK(trace::steered_words(run, *steered) == "loose: at most observe");
    REQUIRE(guarded != story.points.end());
    CHECK(guarded->chain == 0);
    CHECK(trace::steered_words(run, *guarded) ==
          std::string("tight: guard: ") + sched::to_word(f.rt().guard().mode(0)));
    std::vector<std::string> instants;
    for (const trace::Track& track : trace::timeline(run, story))
        for (const trace::TrackInstant& instant : track.instants) instants.push_back(instant.name);
    CHECK(std::count(instants.begin(), instants.end(), "loose: at most observe") == 1);
}

TEST_CASE("Status page tells the priority of a task's launches, whether they are recorded or not",
          "[runtime][records][status_page]") {
    RuntimeFixture f;
    CHECK(f.rt().status().task(0).priority == 0);
    f.begin(f.thread_a, "tight");
    const Grant first = f.launch(f.thread_a);
    CHECK(first.priority != 0);
    CHECK(f.rt().status().task(0).priority == first.priority);
    CHECK(f.rt().status().task(1).priority == 0);
    CHECK_FALSE(f.rt().observers().records.are_on());
}
