// SPDX-License-Identifier: Apache-2.0
//
// Equal chains: the config and the profile of so many copies of one.
#include "tools/bench/measure/equal_chains.h"

#include "host/config/config_reader.h"
#include "tests/support/catch.h"

namespace urgengo::cli {
namespace {

using namespace std::chrono_literals;

config::Chain c3() {
    config::Chain chain{"C3", 200ms, 60ms, {}, {}};
    chain.tasks = {{"detect2d"}, {"sign"}};
    return chain;
}

TEST_CASE("Equal chains are configured without deadlines at their rate", "[unit][cli]") {
    const auto config = config::parse_config(equal_chains_yaml(c3(), 12, 4, false), "yaml");
    REQUIRE(config);
    REQUIRE(config->chains.size() == 12);
    const config::Chain& last = config->chains.back();
    CHECK(last.name == "x12C3");
    CHECK(last.period == 50ms);
    CHECK(last.deadline == 5s);
    CHECK(last.on_late == config::OnLate::kContinue);
    CHECK(last.arrival == config::ArrivalFrom::kHint);
    REQUIRE(last.tasks.size() == 2);
    CHECK(last.tasks[1].name == "sign");
    CHECK(last.tasks[1].thread_glob == "x12C3*");
}

TEST_CASE("As many equal chains of one task fit as a config has tasks", "[unit][cli]") {
    const auto config = config::parse_config(equal_chains_yaml(c3(), 256, 1, true), "yaml");
    REQUIRE(config);
    REQUIRE(config->chains.back().tasks.size() == 1);
    CHECK(config->chains.back().tasks[0].name == "detect2d");
    CHECK(!config::parse_config(equal_chains_yaml(c3(), 129, 1, false), "yaml"));
}

TEST_CASE("Every copy has the profile of the one that was learned", "[unit][cli]") {
    config::Profile learned;
    learned.gpu = "a GPU";
    learned.chains = {{"x01C3", {{"detect2d", 7ms, {{"kernel", 3, 256, 5us, 0.5, 1}}}}}};
    const config::Profile profile = profile_of_copies(learned, 3);
    CHECK(profile.gpu == "a GPU");
    REQUIRE(profile.chains.size() == 3);
    CHECK(profile.chains[0].name == "x01C3");
    CHECK(profile.chains[2].name == "x03C3");
    REQUIRE(profile.chains[2].tasks.size() == 1);
    CHECK(profile.chains[2].tasks[0].kernels[0].gpu_time == 5us);
}

}  // namespace
}  // namespace urgengo::cli
