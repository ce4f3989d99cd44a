// SPDX-License-Identifier: Apache-2.0
//
// Captures that are under way, and that are not any more: launches need asking only meanwhile.
#include <nlohmann/json.hpp>

#include "tests/interposer/check_twin.h"
#include "tests/support/catch.h"

using namespace urgengo::testing;
using namespace std::chrono_literals;

namespace {

/// @returns launches of the scenario that needed no asking
int as_planned(const std::vector<std::string>& scenario) {
    const Folder folder;
    const auto stats = folder.path() / "stats.json";
    const auto config =
        write_config(folder.path() / "config.json", "urgengo", urgengo::config::Mode::kEnforce,
                     {chain("one", 60s, {{"work", "twin*"}})});
    Environment environment = configured(preloaded(), config, stats);
    environment["SIMGPU_DRIVER"] = "13.3";
    const Outcome outcome = run_twin(scenario, environment);
    INFO(scenario.back() << ": " << outcome.err);
    REQUIRE(outcome.exit_status == 0);
    const auto root = nlohmann::json::parse(read_text(stats), nullptr, false);
    REQUIRE(!root.is_discarded());
    return root.at("chains").at(0).at("as_planned").get<int>();
}

}  // namespace

TEST_CASE("Captures that nobody ends leave no trace when UrgenGo is loaded",
          "[interposer][twins][graphs]") {
    check_twin({"left_captures"});
}

TEST_CASE("Launches need no asking again when a capture has ended without being ended",
          "[interposer][graphs]") {
    const int undisturbed = as_planned({"left_captures", "none"});
    REQUIRE(undisturbed > 100);
    for (const char* where : {"context", "detach", "reset", "thread", "stream"}) {
        INFO(where);
        CHECK(as_planned({"left_captures", where}) > undisturbed / 2);
    }
}

TEST_CASE("Launches need no asking when an unknown entry that would capture is only asked for",
          "[interposer][graphs]") {
    CHECK(as_planned({"left_captures", "asked"}) > as_planned({"left_captures", "none"}) / 2);
}

TEST_CASE("Graph has the program's own work only when an unknown entry captures it",
          "[interposer][twins][graphs]") {
    Scenario scenario{"recapture"};
    scenario.environment = {{"SIMGPU_DRIVER", "13.3"}};
    check_twin(scenario);
}
