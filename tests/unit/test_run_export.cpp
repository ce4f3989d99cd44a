// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/run_export.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/support/perfetto_reader.h"
#include "tests/support/run_builder.h"
#include "tools/trace/run_pieces.h"

using namespace urgengo;
using nlohmann::json;
using testing::read_perfetto;
using testing::RunBuilder;
using Read = testing::PerfettoTrace;

namespace {

struct Exported {
    trace::Run run;
    trace::RunStory story;
};

Exported late_frame() {
    RunBuilder builder;
    builder.add_a_late_frame();
    auto run = trace::parse_run(builder.bytes(), "f");
    REQUIRE(run);
    trace::RunStory story = trace::tell(*run);
    return {std::move(*run), std::move(story)};
}

}  // namespace

TEST_CASE("Perfetto's protobuf has tracks, slices, counters and clocks of a run", "[trace][run]") {
    const Exported from = late_frame();
    const Read read = read_perfetto(trace::to_perfetto(from.run, from.story));
    CHECK(read.process == from.run.program);
    using Clocks = std::vector<std::uint64_t>;
    CHECK(read.clocks.at(3) ==
          Clocks{static_cast<std::uint64_t>(from.run.begin_ns), 1068 * RunBuilder::kMs});
    CHECK(read.clocks.at(1) == Clocks{static_cast<std::uint64_t>(from.run.begin_realtime_ns)});
    CHECK(read.clocks.at(64) == Clocks{5'000'000});
    CHECK(read.num_counters == 4 * from.run.tasks.size());
    const auto& frames = read.events.at("lidar/frames");
    REQUIRE(frames.size() == 2);
    CHECK(frames[0].name == "lidar #17 late");
    CHECK(frames[0].type == 1);
    CHECK(frames[0].time_ns == 1000 * RunBuilder::kMs);
    CHECK(frames[0].texts.at("cause") == "held behind camera");
    CHECK(frames[1].type == 2);
    CHECK(frames[1].time_ns == 1095 * RunBuilder::kMs);
    for (const char* track : {"lidar/detect", "lidar/detect: GPU", "lidar/detect: held",
                              "lidar/detect: waits", "camera/detect: GPU"})
        CHECK(read.events.at(track).size() == 2);
    const auto& kernels = read.events.at("lidar/detect: kernel");
    REQUIRE(kernels.size() == 1);
    CHECK(kernels[0].type == 4);
    CHECK(kernels[0].value == 3);
    CHECK(kernels[0].time_ns == 1069 * RunBuilder::kMs);  // when the GPU executed it
    CHECK(read.events.at("lidar/detect: laxity")[0].value == -5);
    const auto& held = read.events.at("lidar/detect: held so far");
    REQUIRE(held.size() == 2);
    CHECK((held[0].value == 0 && held[0].time_ns == 1006 * RunBuilder::kMs));
    CHECK((held[1].value == 50 && held[1].time_ns == 1056 * RunBuilder::kMs));
}

TEST_CASE("Launches between two marks are a slice on their stream's track, on the GPU's clock",
          "[trace][run]") {
    const Exported from = late_frame();
    const Read read = read_perfetto(trace::to_perfetto(from.run, from.story));
    const auto& detect = read.events.at("streams/stream 2");
    REQUIRE(detect.size() == 4);
    CHECK(detect[0].name == "lidar/detect: launches 0..2");
    CHECK(detect[0].time_ns == 1005 * RunBuilder::kMs);
    CHECK(detect[0].texts.at("frame") == "lidar #17");
    CHECK(detect[0].texts.at("end_by") == "GPU's clock");
    CHECK(detect[1].time_ns == 1069 * RunBuilder::kMs);
    CHECK(detect[2].name == "lidar/detect: launches 3..4");
    CHECK(detect[2].time_ns == 1069 * RunBuilder::kMs);
    CHECK(detect[2].texts.at("end_by") == "host");
    CHECK(detect[3].time_ns == 1091 * RunBuilder::kMs);
    const auto& camera = read.events.at("streams/stream 3");
    REQUIRE(camera.size() == 2);
    CHECK(camera[0].name == "camera/detect: launches 0..3");
}

TEST_CASE("Launches are named by the kernels that are planned, where the run has them",
          "[trace][run]") {
    const auto names_with = [](const std::string& conditions) {
        Exported from = late_frame();
        from.run.conditions = conditions;
        const Read read = read_perfetto(trace::to_perfetto(from.run, from.story));
        const auto& detect = read.events.at("streams/stream 2");
        return std::pair{detect[0].name, detect[2].name};
    };
    using Names = std::pair<std::string, std::string>;
    // Launches 0..2 and 3..4 of lidar/detect.
    CHECK(names_with(R"({"kernels": {"names": ["conv", "relu", "pool", "fc"],
                                     "launches": [[0, 1, 0, 3, 3], [], [0]]}})") ==
          Names{"lidar/detect: conv, relu", "lidar/detect: fc"});
    const Names without{"lidar/detect: launches 0..2", "lidar/detect: launches 3..4"};
    CHECK(names_with(R"({"kernels": {"names": ["conv"], "launches": [[0, 0, 0]]}})") ==
          Names{"lidar/detect: conv", without.second});
    for (const char* wrong :
         {R"({"kernels": 3})", R"({"kernels": {"names": 1, "launches": [[0]]}})",
          R"({"kernels": {"names": ["a"], "launches": [[0, 7, 0, -1, "x"]]}})",
          R"({"kernels": {"names": [4], "launches": [[0, 0, 0, 0, 0]]}})", "[1", "[]", ""}) {
        INFO(wrong);
        CHECK(names_with(wrong) == without);
    }
}

TEST_CASE("Pieces are told from marks that are seen late, out of order or not on the GPU's clock",
          "[trace][run]") {
    RunBuilder builder;
    builder.segment(false, 0, 0, 10, 20, 20, 0, 0);
    builder.mark(0, 0, 31, 30, 2, 2);
    builder.mark(0, 0, 41, 25, 4, 2);     // it says more than the one before, and no later
    builder.mark(0, 0, 45, 0, 5, 2);      // a stream write, say
    builder.mark(0, 0, 46, 45, 5, 2, 7);  // another instance's
    builder.segment(true, 0, 0, 10, 60, 20, 9, 2);
    builder.mark(0, 0, 70, 50, 8, 1);
    builder.segment(false, 0, 0, 10, 80, 80, 9, 1);   // its end was lost
    builder.segment(false, 0, 0, 10, 92, 92, 10, 1);  // the process ends in it
    builder.mark(0, 0, 95, 90, 10, 1);
    builder.mark(0, 0, 96, 95, 12, 1);
    const auto run = trace::parse_run(builder.bytes(), "f");
    REQUIRE(run);
    const auto pieces = trace::gpu_pieces(*run, trace::tell(*run));
    std::string told;
    for (const trace::RunPiece& piece : pieces)
        told += fmt::format("{} {}-{} on {}{}; ", trace::launches_words(piece),
                            piece.begin_ns / RunBuilder::kMs, piece.end_ns / RunBuilder::kMs,
                            piece.stream, piece.is_on_gpu_clock ? "" : " by host");
    CHECK(told ==
          "launches 0..1 20-30 on 2; launches 2..3 30-41 on 2 by host; "
          "launch 4 41-45 on 2 by host; launches 5..7 45-50 on 1; launch 8 50-60 on 2 by host; "
          "launch 9 80-90 on 1; launches 10..11 92-95 on 1; ");
}

TEST_CASE("Records that know no streams have a track of the GPU for each task", "[trace][run]") {
    RunBuilder builder;
    builder.segment(false, 0, 0, 10, 20, 20, 0, 0);
    builder.segment(true, 0, 0, 10, 30, 20, 2, 0);
    builder.segment(false, 1, 2, 10, 40, 40, 0, 1);
    builder.segment(true, 1, 2, 10, 50, 40, 1, 1);
    builder.segment(false, 0, 1, 10, 60, 60, 0, 0);
    builder.segment(true, 0, 1, 10, 70, 60, 1, 0);
    const auto run = trace::parse_run(builder.bytes(), "f");
    REQUIRE(run);
    const Read read = read_perfetto(trace::to_perfetto(*run, trace::tell(*run)));
    CHECK(read.events.at("streams/lidar/detect").size() == 2);
    CHECK(read.events.at("streams/lidar/track").size() == 2);
    CHECK(read.events.at("streams/default stream").size() == 2);
}

TEST_CASE("Snapshots of the GPU's clock go on where it wraps, and leave out what goes back",
          "[trace][run]") {
    RunBuilder builder;
    constexpr std::uint64_t kWraps = std::uint64_t{1} << 48;
    builder.clock(10, 10, kWraps - 5);
    builder.clock(20, 20, 7);
    builder.clock(30, 30, 6);
    builder.clock(40, 19, 8);
    builder.clock(50, 50, 9);
    const auto run = trace::parse_run(builder.bytes(), "f");
    REQUIRE(run);
    const Read read = read_perfetto(trace::to_perfetto(*run, trace::tell(*run)));
    CHECK(read.clocks.at(64) == std::vector<std::uint64_t>{kWraps - 5, kWraps + 7, kWraps + 9});
}

TEST_CASE("Arrow goes from the work of the chain that a launch was held behind to the hold",
          "[trace][run]") {
    const Exported from = late_frame();
    const Read read = read_perfetto(trace::to_perfetto(from.run, from.story));
    const auto& hold = read.events.at("lidar/detect: held")[0];
    CHECK(hold.name == "held behind camera");
    CHECK(hold.texts.at("behind") == "camera/detect");
    CHECK(hold.texts.at("frame") == "lidar #17");
    REQUIRE(hold.last_flows.size() == 1);
    const auto& work = read.events.at("camera/detect: GPU")[0];
    CHECK(work.flows == hold.last_flows);

    const json chrome = json::parse(trace::to_chrome(from.run, from.story));
    std::map<std::string, int> phases;
    for (const json& event : chrome.at("traceEvents")) {
        ++phases[event.at("ph").get<std::string>()];
        if (event.at("ph") == "f") CHECK(event.at("bp") == "e");
    }
    CHECK(phases["s"] == 1);
    CHECK(phases["f"] == 1);
    CHECK(phases["X"] == 11);  // 2 frames, tasks and segments, a hold, a wait, 3 pieces
    CHECK(phases["C"] == 4);
}

TEST_CASE("Frames that are under way at once are on tracks of their own", "[trace][run]") {
    RunBuilder builder;
    builder.frame_begins(0, 1, 10);
    builder.frame_begins(0, 2, 20);
    builder.frame_ends(0, 10, 30);
    builder.frame_ends(0, 20, 40);
    builder.frame_begins(0, 3, 40);
    builder.frame_ends(0, 40, 50);
    const auto run = trace::parse_run(builder.bytes(), "f");
    REQUIRE(run);
    const Read read = read_perfetto(trace::to_perfetto(*run, trace::tell(*run)));
    const auto named_frames = [&](const auto& entry) { return entry.second == "frames"; };
    CHECK(std::count_if(read.tracks.begin(), read.tracks.end(), named_frames) == 3);
    CHECK(read.events.at("lidar/frames").size() == 6);
}

TEST_CASE("Late frame is written for Perfetto's own decoder", "[.][perfetto_file]") {
    const Exported from = late_frame();
    std::ofstream(std::getenv("URGENGO_TEST_PERFETTO"), std::ios::binary)
        << trace::to_perfetto(from.run, from.story);
}

TEST_CASE("Table of a run has a line for each thing, and quotes names that need it",
          "[trace][run]") {
    const Exported from = late_frame();
    const std::string csv = trace::to_csv(from.run, from.story);
    std::size_t lines = 0;
    for (std::size_t at = 0; (at = csv.find('\n', at)) != std::string::npos; ++at) ++lines;
    CHECK(lines == 1 + 8 + 3 + 2);
    const std::string header =
        "kind,chain,frame,task,thread,begin_ns,end_ns,why,behind,cause_ns,value,stream\n";
    CHECK(csv.find(header) == 0);
    for (const char* line : {"frame,lidar,17,,,1000000000,1095000000,held,camera,50000000,,\n",
                             ",1006000000,1056000000,more urgent work fills the GPU,camera,,,\n",
                             "gpu_launches,lidar,17,detect,,1005000000,1069000000,,,,0-2,2\n",
                             ",1068000000,1068000000,,,,5000000,\n"})
        CHECK(csv.find(line) != std::string::npos);
    std::istringstream rows(csv);
    for (std::string row; std::getline(rows, row);)
        CHECK(std::count(row.begin(), row.end(), ',') == 11);
    Exported named = late_frame();
    named.run.chains[0].name = "li\"dar, front";
    CHECK(trace::to_csv(named.run, named.story).find("frame,\"li\"\"dar, front\",17,") !=
          std::string::npos);
}
