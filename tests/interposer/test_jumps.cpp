// SPDX-License-Identifier: Apache-2.0
//
// A program whose signal handler jumps out of launches that take long (scenario_jumps.cpp). Not
// with sanitizers, which have handlers run when it suits them. Hidden, to be run on request by
// [jumps]: on busy cores a launch that is not held may last as long, and then the jump is out of
// the driver.
#include <nlohmann/json.hpp>

#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;

TEST_CASE("Program that jumps out of held launches goes on, and is scheduled",
          "[.][interposer][jumps]") {
    const Folder folder;
    const auto stats = folder.path() / "stats.json";
    std::vector<config::Chain> chains{chain("urgent", 5s, {{"work", "urgent"}}),
                                      chain("loose", 20s, {{"work", "loose"}})};
    const auto config =
        write_config(folder.path() / "config.json", "urgengo", config::Mode::kEnforce, chains);
    const Outcome alone = run_twin({"jumps"}, bare());
    const Outcome outcome = run_twin({"jumps"}, configured(preloaded(), config, stats));
    CHECK(alone.out == "and it goes on\n");
    CHECK(outcome.exit_status == 0);
    CHECK(outcome.out == alone.out);
    INFO(outcome.err);
    CHECK(outcome.err.find("the program jumped out of a held launch") != std::string::npos);
    const auto found = nlohmann::json::parse(read_text(stats), nullptr, false);
    REQUIRE(!found.is_discarded());
    CHECK(found.at("tripped") == "");
    // It jumps as often as it is held: once alone would mean that it is left alone from then on.
    CHECK(found.at("chains").at(1).at("holds") > 3);
}
