// SPDX-License-Identifier: Apache-2.0
//
// Causes of misses from end to end: put into the frames of a program on the simulated GPU, and
// found by UrgenGo in them, whatever else the test's machine does. In virtual time, and among
// noise: tests/unit/test_frame_causes.cpp.
#include <map>
#include <nlohmann/json.hpp>

#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"
#include "tools/trace/run_summary.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
using abi::MissCause;
using std::chrono::nanoseconds;

namespace {

config::TaskProfile profile_of(const char* kernel, std::size_t count, nanoseconds each) {
    config::TaskProfile task;
    task.name = "work";
    task.cpu_time = 1ms;
    task.kernels.assign(count, {kernel, 46, 1024, each, 1.0});
    return task;
}

std::string causes_told(const std::map<std::string, int>& found) {
    std::string text;
    for (const auto& [cause, count] : found) text += std::to_string(count) + " x " + cause + "; ";
    return text;
}

}  // namespace

TEST_CASE("Cause that is put into frames is the one that is named, in 95 of 100",
          "[interposer][causes]") {
    const auto [what, cause, behind] = GENERATE(table<std::string, MissCause, std::string>({
        {"cpu", MissCause::kCpuLonger, ""},
        {"sleep", MissCause::kOutside, ""},
        {"gpu", MissCause::kGpuLonger, ""},
        {"arrival", MissCause::kArrivedLate, ""},
        {"co_runner", MissCause::kKernelInFront, "co"},
    }));
    const MemoryFolder folder;
    config::Profile profile;
    profile.chains = {{"late", {profile_of("work", 10, 300us)}},
                      {"co", {profile_of("co_work", 1, 20ms)}}};
    const auto config =
        write_config(folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
                     {chain("late", 15ms, {{"work", ""}}), chain("co", 1s, {{"work", ""}})},
                     &profile, [](config::Config& c) { c.scheduler.guard = false; });
    const std::string file = folder.path("run.ugtrace");
    const auto stats = folder.path() / "stats.json";
    Environment environment = configured(preloaded(), config, stats);
    environment["URGENGO_RUN_TRACE"] = file;
    const Outcome outcome = run_twin({"causes", what}, environment);
    INFO(outcome.err);  // it warns of chains that start late, say
    REQUIRE(outcome.exit_status == 0);

    const auto run = trace::read_run(file);
    REQUIRE(run);
    const trace::RunStory story = trace::tell(*run);
    std::map<std::string, int> found;
    int total = 0, right = 0;
    for (const std::string& line : lines_of(outcome.out)) {
        const std::size_t index = story.find(0, static_cast<std::uint32_t>(std::stoul(line)));
        REQUIRE(index != trace::kNoFrame);
        const trace::RunFrame& frame = story.frames[index];
        ++total;
        right += frame.cause == cause && trace::chain_name(*run, frame.behind) == behind;
        ++found[trace::outcome_words(*run, frame).substr(0, 70)];
    }
    INFO(what << ": " << right << " of " << total << ": " << causes_told(found));
    if (total < 10) WARN("only " << total << " frames were not disturbed by the machine");
    CHECK(right >= 0.95 * total);

    // The statistics at exit count the same.
    std::map<std::string, std::uint64_t> recorded, counted;
    const auto summary = trace::summarize(*run, story);
    for (const observe::CauseCount& each : summary.at(0).causes)
        recorded[observe::to_word(each.cause) + (" " + each.behind)] += each.count;
    const auto root = nlohmann::json::parse(read_text(stats), nullptr, false);
    REQUIRE_FALSE(root.is_discarded());
    for (const auto& each : root.at("chains").at(0).at("causes"))
        counted[each.at("cause").get<std::string>() + " " + each.at("behind").get<std::string>()] +=
            each.at("frames").get<std::uint64_t>();
    CHECK(counted == recorded);
}
