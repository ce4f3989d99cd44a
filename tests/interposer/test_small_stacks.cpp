// SPDX-License-Identifier: Apache-2.0
//
// Threads with little stack, and threads that jump out of a held launch.
#include <nlohmann/json.hpp>

#include "tests/interposer/check_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;

TEST_CASE("Threads with stacks of 16 KiB do the same when their launches are held",
          "[interposer][twins]") {
    Scenario scenario{"small_stacks"};
    scenario.holds = true;
    check_twin(scenario);
}

TEST_CASE("A thread that jumped out of a hold is scheduled again", "[interposer][scheduling]") {
    const Folder folder;
    const auto stats = folder.path() / "stats.json";
    const auto config = write_config(
        folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
        {chain("tight", 1s, {{"work", "tight"}}), chain("loose", 3600s, {{"work", "loose"}})},
        nullptr, [](config::Config& c) { c.scheduler.share_slack = std::chrono::hours(1); });
    const Outcome outcome = run_twin({"jump_out_of_hold"}, configured(preloaded(), config, stats));
    REQUIRE(outcome.exit_status == 0);
    CHECK(lines_of(outcome.out).front() == "jumped");
    CHECK(outcome.err.find("jumped out of a held launch (siglongjmp): 1 times") !=
          std::string::npos);
    const auto root = nlohmann::json::parse(read_text(stats), nullptr, false);
    REQUIRE(!root.is_discarded());
    CHECK(root.at("chains").at(1).at("scheduled") == 20);
}
