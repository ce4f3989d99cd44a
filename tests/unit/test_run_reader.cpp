// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/run_reader.h"

#include <algorithm>
#include <cstring>
#include <fstream>
#include <limits>
#include <random>

#include "tests/support/folder.h"
#include "tests/support/run_builder.h"
#include "tools/trace/run_export.h"
#include "tools/trace/run_story.h"
#include "tools/trace/run_summary.h"

using namespace urgengo;
using abi::RunKeeps;
using abi::RunKind;
using testing::RunBuilder;

namespace {

template <typename T>
void store(std::string& bytes, std::size_t offset, T value) {
    std::memcpy(bytes.data() + offset, &value, sizeof value);
}

std::string error_of(const std::string& bytes) {
    const auto run = trace::parse_run(bytes, "f");
    return run ? "none" : run.error();
}

}  // namespace

TEST_CASE("Reader of runs says what it found and what it accepts", "[trace][run]") {
    const RunBuilder builder;
    const std::string good = builder.bytes();
    CHECK(error_of("") == "f: found 0 bytes, accepted: a run's records (at least 320)");
    CHECK(error_of(std::string(4096, '\0')) ==
          "f: found a file that was not begun, accepted: a run's records");
    CHECK(error_of(std::string(4096, 'x')).find("found magic 7878787878787878") !=
          std::string::npos);
    const auto with = [&](std::size_t offset, std::uint32_t value) {
        std::string bytes = good;
        store(bytes, offset, value);
        return error_of(bytes);
    };
    CHECK(with(offsetof(abi::RunHeader, version), 0) ==
          "f: found version 0, accepted: 1 and later");
    CHECK(with(offsetof(abi::RunHeader, record_bytes), 8) ==
          "f: found records of 8 bytes, accepted: 64 to 4096");
    CHECK(with(offsetof(abi::RunHeader, ring_records), 0xffffffff).find("found rings of") !=
          std::string::npos);
    CHECK(with(offsetof(abi::RunHeader, chains.count), 0x7000).find("found 28672 chains") !=
          std::string::npos);
    CHECK(with(offsetof(abi::RunHeader, tasks.offset), 0xfffffff0).find("tasks of 96 bytes") !=
          std::string::npos);
    CHECK(with(offsetof(abi::RunHeader, rings.element_bytes), 64).find("found rings of 64") !=
          std::string::npos);
    CHECK_FALSE(trace::read_run("/nonexistent"));
    CHECK(trace::read_run("/nonexistent").error() ==
          "/nonexistent: cannot be read: No such file or directory");
}

TEST_CASE("Reader of runs reads a later version as far as it is known", "[trace][run]") {
    RunBuilder builder;
    builder.add_a_late_frame();
    std::string bytes = builder.bytes();
    store(bytes, offsetof(abi::RunHeader, version), std::uint32_t{7});
    const auto as_it_was = trace::parse_run(bytes, "f");
    REQUIRE(as_it_was);
    auto later = RunBuilder::record(static_cast<RunKind>(200), -1, -1, 0, 1);
    builder.recorder.add(later);
    const auto run = trace::parse_run(builder.bytes(), "f");
    REQUIRE(run);
    CHECK(run->records.size() == as_it_was->records.size());
    REQUIRE(run->warnings.size() == 1);
    CHECK(run->warnings[0] == "f: 1 records of a kind that is not known");
}

TEST_CASE("Reader of runs reads a file that is cut short as far as it goes", "[trace][run]") {
    RunBuilder builder(RunKeeps::kOldest, 64, 4);
    for (std::uint32_t i = 1; i <= 150; ++i) builder.frame_begins(0, i, i);
    const std::string whole = builder.bytes();
    std::size_t before = 0;
    for (std::size_t size = 0; size <= whole.size(); size += 997) {
        const auto run = trace::parse_run(std::string_view(whole).substr(0, size), "f");
        if (!run) continue;
        CHECK(run->records.size() >= before);
        before = run->records.size();
        for (std::size_t i = 0; i < before; ++i) CHECK(run->records[i].number == i + 1);
    }
    CHECK(before > 130);
    CHECK(trace::parse_run(whole, "f")->records.size() == 150);
}

TEST_CASE("Reader of runs leaves out records that make no sense", "[trace][run]") {
    RunBuilder builder;
    builder.add(RunKind::kTaskBegin, 0, 77, 1, 1);
    builder.add(RunKind::kTaskBegin, 9, 0, 1, 1);
    builder.add(RunKind::kTaskBegin, 0, -1, 1, 1);
    builder.add(RunKind::kFrameBegin, -1, -1, 1, 1);
    builder.add(RunKind::kTaskBegin, 0, 0, 1, -5);
    auto strange = RunBuilder::record(RunKind::kHoldEnd, 0, 0, 1, 5, 9);
    strange.behind_chain = 500;
    strange.behind_task = -7;
    strange.why = static_cast<abi::Why>(99);
    strange.cause = static_cast<abi::MissCause>(99);
    builder.recorder.add(strange);
    const auto run = trace::parse_run(builder.bytes(), "f");
    REQUIRE(run);
    REQUIRE(run->records.size() == 1);
    CHECK(run->records[0].behind_chain == -1);
    CHECK(run->records[0].behind_task == -1);
    CHECK(run->records[0].why == abi::Why::kNone);
    CHECK(run->records[0].begin_ns == run->records[0].time_ns);
    CHECK(run->warnings == std::vector<std::string>{"f: 5 records or names make no sense"});
}

TEST_CASE("Reader of runs believes no park or round that took longer than it can", "[trace][run]") {
    RunBuilder builder;
    builder.park(10, 20, 30, 1, 0);
    builder.park(10, 20, -3, 1, 0);
    builder.rounds(30, 20, 1);
    builder.rounds(10, 20, 1, 3, std::numeric_limits<std::int64_t>::max() / RunBuilder::kMs);
    const auto run = trace::parse_run(builder.bytes(), "f");
    REQUIRE(run);
    REQUIRE(run->records.size() == 4);
    CHECK(run->records[0].park.opening_ns == 10 * RunBuilder::kMs);
    CHECK(run->records[1].park.opening_ns == 0);
    CHECK(run->records[2].begin_ns == run->records[2].time_ns);
    CHECK(run->records[2].round.took_ns == 0);
    CHECK(run->records[3].round.took_ns < std::numeric_limits<std::int64_t>::max() / 2);
}

TEST_CASE("Reader of runs, its story and its exports survive any bytes", "[trace][run]") {
    RunBuilder builder(GENERATE(RunKeeps::kNewest, RunKeeps::kOldest), 64, 4);
    for (int i = 0; i < 6; ++i) builder.add_a_late_frame();
    builder.park(1000, 1010, 1, 2, 3);
    builder.rounds(1010, 1011, 4);
    builder.rounds(1000, 1012, 4, 3, 1);
    const std::string good = builder.bytes();
    std::mt19937 random(7);
    for (int round = 0; round < 400; ++round) {
        std::string bytes = good;
        const std::size_t changes = 1 + random() % 40;
        for (std::size_t i = 0; i < changes; ++i) {
            // Mostly where something is.
            const std::size_t most = random() % 4 == 0 ? 400 : bytes.size();
            bytes[random() % most] = static_cast<char>(random() % 3 == 0 ? 0xff : random());
        }
        if (random() % 4 == 0) bytes.resize(random() % bytes.size());
        const auto run = trace::parse_run(bytes, "f");
        if (!run) continue;
        CHECK(run->records.size() <= bytes.size() / sizeof(abi::RunRecord));
        const trace::RunStory story = trace::tell(*run);
        trace::summarize(*run, story);
        CHECK_FALSE(trace::to_perfetto(*run, story).empty());
        CHECK_FALSE(trace::to_chrome(*run, story).empty());
        CHECK_FALSE(trace::to_csv(*run, story).empty());
        for (std::size_t i = 0; i < story.frames.size(); ++i) trace::frame_story(*run, story, i);
    }
}

TEST_CASE("Story of a run tells what was done for a frame, and behind whom it was held",
          "[trace][run]") {
    RunBuilder builder;
    builder.add_a_late_frame();
    const auto run = trace::parse_run(builder.bytes(), "f");
    REQUIRE(run);
    const trace::RunStory story = trace::tell(*run);
    REQUIRE(story.frames.size() == 2);
    const std::size_t index = story.find(0, 17);
    REQUIRE(index == 0);
    CHECK(story.find(0, 18) == trace::kNoFrame);
    CHECK(trace::frame_name(*run, story.frames[0]) == "lidar #17");
    CHECK(trace::outcome_words(*run, story.frames[0]) ==
          "late by 15.000 ms: held behind camera (50.000 ms)");
    CHECK(trace::outcome_words(*run, story.frames[1]) == "in time");
    trace::RunFrame early = story.frames[0];
    early.exited = true;
    CHECK(trace::outcome_words(*run, early) == "ended early: held behind camera (50.000 ms)");
    early.cause = abi::MissCause::kEndedEarly;
    early.cause_detail = 0;
    CHECK(trace::outcome_words(*run, early) == "ended early, as it could not be in time");
    std::string told;
    for (const trace::StoryLine& line : trace::frame_story(*run, story, index)) {
        std::string what = line.what;
        if (const std::size_t thread = what.find(", thread"); thread != std::string::npos)
            what.resize(thread);
        told += std::to_string(line.begin_ns / RunBuilder::kMs) + "-" +
                std::to_string(line.end_ns / RunBuilder::kMs) + " " + what + "\n";
    }
    CHECK(told ==
          "0-0 arrived\n"
          "1-92 detect works on it\n"
          "5-91 GPU segment, 86.000 ms\n"
          "6-56 held behind camera, 50.000 ms: more urgent work fills the GPU\n"
          "60-90 waits for the GPU, 30.000 ms\n"
          "95-95 came to its end\n");
    const auto others = trace::meanwhile(story, index);
    REQUIRE(others.size() == 1);
    CHECK(others[0].chain == 1);
    CHECK(others[0].time_ns == 50 * RunBuilder::kMs);
    const auto held = trace::held_behind(story, index);
    REQUIRE(held.size() == 1);
    CHECK(held[0].chain == 1);
    CHECK(held[0].time_ns == 50 * RunBuilder::kMs);
    const auto chains = trace::summarize(*run, story);
    CHECK(chains[0].late == 1);
    CHECK(chains[0].holds == 1);
    CHECK(chains[0].held_ns == 50 * RunBuilder::kMs);
    REQUIRE(chains[0].causes.size() == 1);
    CHECK(chains[0].causes[0].behind == "camera");
    CHECK(chains[1].late == 0);
}

TEST_CASE("What has no end in the recording is open, to its task's end at most", "[trace][run]") {
    RunBuilder builder;
    builder.frame_begins(0, 1, 10);
    builder.add(RunKind::kTaskBegin, 0, 0, 10, 11);
    builder.hold(false, 0, 0, 10, 12, 12, 1, 2);  // its thread jumps out of it
    builder.add(RunKind::kTaskEnd, 0, 0, 10, 20, 11);
    builder.frame_begins(1, 1, 30);
    builder.add(RunKind::kTaskBegin, 1, 2, 30, 31);
    builder.hold(false, 1, 2, 30, 32, 32, 0, 0);  // the program hangs there
    builder.frame_begins(0, 2, 40);
    const auto run = trace::parse_run(builder.bytes(), "f");
    REQUIRE(run);
    const trace::RunStory story = trace::tell(*run);
    std::vector<const trace::RunSlice*> holds;
    for (const trace::RunSlice& slice : story.slices)
        if (slice.kind == trace::RunSlice::Kind::kHold) holds.push_back(&slice);
    REQUIRE(holds.size() == 2);
    CHECK(holds[0]->is_open);
    CHECK(holds[0]->end_ns == 20 * RunBuilder::kMs);
    CHECK(holds[1]->is_open);
    CHECK(holds[1]->end_ns == 40 * RunBuilder::kMs);
    CHECK_FALSE(story.frames[0].has_ended);
    CHECK(trace::outcome_words(*run, story.frames[0]) == "its end is not recorded");
}

TEST_CASE("Frame whose begin was overwritten is numbered back from the next one", "[trace][run]") {
    RunBuilder builder;
    builder.frame_ends(0, 10, 20);
    builder.frame_ends(0, 110, 120);
    builder.frame_begins(0, 9, 210);
    builder.frame_ends(1, 5, 15);  // of a chain without any begin
    const auto run = trace::parse_run(builder.bytes(), "f");
    REQUIRE(run);
    const trace::RunStory story = trace::tell(*run);
    CHECK(story.find(0, 7) == 0);
    CHECK(story.find(0, 8) == 1);
    CHECK(story.find(0, 9) == 2);
    CHECK(trace::frame_name(*run, story.frames[3]) == "camera #?");
}

TEST_CASE("Reader of runs looks at no more than the file has, whatever a ring says",
          "[trace][run]") {
    RunBuilder builder;
    builder.add_a_late_frame();
    std::string bytes = builder.bytes();
    // As long as a ring can be: 4 GB, of which the file has 8 KB.
    constexpr std::uint32_t kRecords = 60'000'001;
    store(bytes, offsetof(abi::RunHeader, ring_records), kRecords);
    store(bytes, offsetof(abi::RunHeader, rings.element_bytes), ~std::uint32_t{0} - 63);
    store(bytes, offsetof(abi::RunHeader, keeps), GENERATE(0u, 1u, 7u));
    abi::RunHeader header{};
    std::memcpy(&header, bytes.data(), sizeof header);
    const auto written = GENERATE(std::uint64_t{kRecords} - 1, std::uint64_t{1} << 48,
                                  (std::uint64_t{1} << 48) + 1, ~std::uint64_t{0});
    store(bytes, header.rings.offset + offsetof(abi::RunRing, written), written);
    for (int i = 0; i < 100; ++i) {
        const auto run = trace::parse_run(bytes, "f");
        REQUIRE(run);
        REQUIRE(run->records.size() <= bytes.size() / sizeof(abi::RunRecord));
        REQUIRE_FALSE(run->warnings.empty());
    }
}

TEST_CASE("Sums over a run whose times cannot be true stay numbers", "[trace][run]") {
    constexpr std::int64_t kMost = std::numeric_limits<std::int64_t>::max();
    RunBuilder builder;
    constexpr std::int64_t far = std::int64_t{100} * 365 * 24 * 3600 * 1000;  // ms
    for (int i = 0; i < 4; ++i) {
        builder.frame_begins(0, 1, 0);
        builder.hold(true, 0, 0, 0, far, 1, 1, 2);
        builder.frame_ends(0, 0, far, abi::MissCause::kHeld, 1, kMost / RunBuilder::kMs);
    }
    std::string bytes = builder.bytes();
    abi::RunHeader header{};
    std::memcpy(&header, bytes.data(), sizeof header);
    store(bytes, header.chains.offset + offsetof(abi::RunChain, deadline_ns),
          std::numeric_limits<std::int64_t>::min());
    store(bytes, offsetof(abi::RunHeader, begin_ns), std::numeric_limits<std::int64_t>::min());
    const auto run = trace::parse_run(bytes, "f");
    REQUIRE(run);
    const trace::RunStory story = trace::tell(*run);
    const auto chains = trace::summarize(*run, story);
    CHECK(chains[0].late == 1);
    CHECK(chains[0].held_ns == kMost);
    CHECK(trace::outcome_words(*run, story.frames[0]).rfind("late by ", 0) == 0);
    CHECK(trace::held_behind(story, 0)[0].time_ns == kMost);
    CHECK_FALSE(trace::to_chrome(*run, story).empty());
}

TEST_CASE("Reader of runs tells how far it is", "[trace][run]") {
    const testing::Folder folder;
    RunBuilder builder;
    builder.add(RunKind::kFrameBegin, 0, -1, 1, 1);
    const std::string file = folder.path("run.ugtrace");
    std::ofstream(file, std::ios::binary) << builder.bytes();
    std::vector<double> parts;
    REQUIRE(trace::read_run(file, [&](double part) { parts.push_back(part); }));
    REQUIRE(parts.size() >= 2);
    CHECK(std::is_sorted(parts.begin(), parts.end()));
    CHECK(parts.front() > 0);
    CHECK(parts.back() < 1);
}
