// SPDX-License-Identifier: Apache-2.0
//
// Rounds and parks of a run, as exports and its summary tell them.
#include "tests/support/perfetto_reader.h"
#include "tests/support/run_builder.h"
#include "tools/trace/run_export.h"
#include "tools/trace/run_summary.h"

using namespace urgengo;
using testing::RunBuilder;

TEST_CASE("Parks and rounds that opened gates are on the dispatcher's tracks", "[trace][run]") {
    RunBuilder builder;
    builder.rounds(10, 11, 2);
    builder.rounds(15, 30, 5, 40, 3);
    builder.park(40, 47, 1, 3, 2);
    builder.rounds(50, 51, 1);
    const auto run = trace::parse_run(builder.bytes(), "f");
    REQUIRE(run);
    const trace::RunStory story = trace::tell(*run);
    const auto read = testing::read_perfetto(trace::to_perfetto(*run, story));
    const auto& rounds = read.events.at("dispatcher/rounds");
    REQUIRE(rounds.size() == 4);
    CHECK(rounds[0].name == "opens gates");
    CHECK(rounds[0].time_ns == 10 * RunBuilder::kMs);
    CHECK(rounds[1].time_ns == 11 * RunBuilder::kMs);
    CHECK(rounds[2].time_ns == 50 * RunBuilder::kMs);
    const auto& by_gpu = read.events.at("dispatcher/rounds of the GPU");
    REQUIRE(by_gpu.size() == 1);
    CHECK(by_gpu[0].type == 3);  // a moment: when they were is not known
    CHECK(by_gpu[0].name == "opened 5 times in 40 rounds");
    CHECK(by_gpu[0].time_ns == 30 * RunBuilder::kMs);
    const auto& parks = read.events.at("dispatcher/parks");
    REQUIRE(parks.size() == 2);
    CHECK(parks[0].name == "no gate is closed");
    CHECK(parks[0].time_ns == 40 * RunBuilder::kMs);
    CHECK(parks[1].time_ns == 47 * RunBuilder::kMs);
    const std::string csv = trace::to_csv(*run, story);
    for (const char* line :
         {"park,,,,1,40000000,47000000,,,,3,\n", "round,,,,1,10000000,11000000,,,,2,\n",
          "gpu_rounds,,,,1,15000000,30000000,,,,5,\n"}) {
        std::string its = line;
        const std::string thread = std::to_string(run->records[0].thread);
        its.replace(its.find(",1,") + 1, 1, thread);
        CHECK(csv.find(its) != std::string::npos);
    }
    CHECK(trace::gates_words(trace::summarize_gates(story)) ==
          "2 rounds of the host opened 3 gates; the GPU opened some 5 times, in 40 rounds of "
          "75.0 us; no gate was closed in 1 parks, 7.000 ms in all, 7.000 ms at most, of which "
          "opening took 1.000 ms at most; 2 launches waited in their threads then");
}

TEST_CASE("Run without gates has no track of a dispatcher and no words of one", "[trace][run]") {
    RunBuilder builder;
    builder.add_a_late_frame();
    const auto run = trace::parse_run(builder.bytes(), "f");
    REQUIRE(run);
    const trace::RunStory story = trace::tell(*run);
    const auto read = testing::read_perfetto(trace::to_perfetto(*run, story));
    for (const auto& [id, name] : read.tracks) CHECK(name != "dispatcher");
    CHECK(trace::gates_words(trace::summarize_gates(story)) == "");
}
