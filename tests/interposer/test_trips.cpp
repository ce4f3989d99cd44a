// SPDX-License-Identifier: Apache-2.0
//
// An error of UrgenGo's own, from end to end: the program does what it does without UrgenGo, which
// only counts from there on, or nothing after a second one, and what was before is kept.
#include <nlohmann/json.hpp>

#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"
#include "tools/trace/run_story.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;

TEST_CASE("UrgenGo that finds no memory only counts, then does nothing, and the program goes on",
          "[interposer][trips]") {
    const auto scenario = GENERATE(std::vector<std::string>{"trips", "first"},
                                   std::vector<std::string>{"trips", "first", "second"});
    const Outcome alone = run_twin(scenario, bare());
    REQUIRE(alone.exit_status == 0);

    const MemoryFolder folder;
    config::TaskProfile task;
    task.name = "work";
    task.kernels.assign(3, {"wide", 46, 1024, 300us, 1.0});
    config::Profile profile;
    profile.chains = {{"steady", {task}}};
    const auto config =
        write_config(folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
                     {chain("steady", 1s, {{"work", ""}})}, &profile);
    const auto stats = folder.path() / "stats.json";
    Environment environment = configured(preloaded(), config, stats);
    environment["LD_PRELOAD"] += std::string(":") + FAILING_ALLOCATOR_PATH;
    environment["URGENGO_SHARE"] = folder.path().string();
    const Outcome outcome = run_twin(scenario, environment);
    CHECK(outcome.exit_status == 0);
    CHECK(outcome.out == alone.out);

    // One line, which names what is kept.
    auto lines = lines_of(outcome.err);
    INFO(outcome.err);
    std::erase_if(lines, [](const std::string& line) {
        return line.rfind("urgengo: warning: ", 0) == 0;  // at exit
    });
    REQUIRE(lines.size() == 1);
    const std::string begin =
        "urgengo: EXIT: an internal error; from here on UrgenGo only counts frames, and changes "
        "nothing; what it did before: urgengo trace info ";
    REQUIRE(lines[0].rfind(begin, 0) == 0);
    const auto run = trace::read_run(lines[0].substr(begin.size()));
    REQUIRE(run);
    REQUIRE_FALSE(run->records.empty());
    CHECK(run->records.back().kind == abi::RunKind::kTrip);
    const auto ended = [](const trace::RunFrame& frame) { return frame.has_ended; };
    const trace::RunStory story = trace::tell(*run);
    CHECK(std::count_if(story.frames.begin(), story.frames.end(), ended) == 20);

    const auto root = nlohmann::json::parse(read_text(stats), nullptr, false);
    REQUIRE_FALSE(root.is_discarded());
    CHECK(root.at("mode") == "tripped");
    CHECK(root.at("tripped") == "an internal error");
    const nlohmann::json& steady = root.at("chains").at(0);
    CHECK(steady.at("finished") == 40);  // those after the first time are counted
    CHECK(steady.at("scheduled") == 20 * 4);
}
