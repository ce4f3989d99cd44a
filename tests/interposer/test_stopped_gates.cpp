// SPDX-License-Identifier: Apache-2.0
//
// A program that is stopped, or killed, while it launches behind gates; one in which none may be.
#include <signal.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <thread>

#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;

namespace {

constexpr int kStops = 4;

/// Of "periods": "loose" is mostly behind "tight".
std::filesystem::path gated_config(const Folder& folder,
                                   const std::function<void(config::Config&)>& dispatch) {
    std::vector<config::Chain> chains{chain("tight", 24ms, {{"work", "tight"}}),
                                      chain("loose", 50ms, {{"work", "loose"}})};
    chains[0].period = 40ms;
    config::Profile profile;
    profile.chains = {{"tight", {periods_profile(16, 500us)}},
                      {"loose", {periods_profile(60, 500us)}}};
    return write_config(folder.path() / "config.json", "urgengo", config::Mode::kEnforce, chains,
                        &profile, dispatch);
}

std::function<void(config::Config&)> any_dispatch() {
    using config::DeviceDispatch;
    switch (GENERATE(0, 1, 2, 3)) {
        case 0:
            return dispatched_by(config::Dispatch::kHost);
        case 1:
            return dispatched_by(DeviceDispatch::kLeased);
        case 2:
            return dispatched_by(DeviceDispatch::kArmed);
        default:
            return dispatched_by(DeviceDispatch::kPiggyback);
    }
}

}  // namespace

TEST_CASE("A program with gates that is stopped goes on when it continues", "[interposer][gates]") {
    const Folder folder;
    const auto stats = folder.path() / "stats.json";
    Running running({placed(TWIN_PATH), "periods", "1.5"},
                    configured(preloaded(), gated_config(folder, any_dispatch()), stats));
    for (int i = 0; i < kStops; ++i) {
        std::this_thread::sleep_for(250ms);
        REQUIRE(kill(running.process(), SIGSTOP) == 0);
        std::this_thread::sleep_for(50ms);
        REQUIRE(kill(running.process(), SIGCONT) == 0);
    }
    const Outcome outcome = running.wait();
    INFO(outcome.err);
    CHECK(outcome.exit_status == 0);
    const auto found = nlohmann::json::parse(read_text(stats), nullptr, false);
    REQUIRE(!found.is_discarded());
    CHECK(found.at("tripped") == "");
    CHECK(found.at("gates").at("closed") > 0);
}

TEST_CASE("A program with gates that is killed ends at once", "[interposer][gates]") {
    const Folder folder;
    Running running({placed(TWIN_PATH), "periods", "20"},
                    configured(preloaded(), gated_config(folder, any_dispatch())));
    std::this_thread::sleep_for(400ms);
    const auto begin = std::chrono::steady_clock::now();
    REQUIRE(kill(running.process(), SIGKILL) == 0);
    CHECK(running.wait().exit_status == 128 + SIGKILL);
    CHECK(std::chrono::steady_clock::now() - begin < 5s);
}

TEST_CASE("Under a tool that serialises kernels no gate is closed, which is said once",
          "[interposer][gates]") {
    const bool is_tool_there = GENERATE(true, false), are_gates_wanted = GENERATE(true, false);
    const Folder folder;
    const auto stats = folder.path() / "stats.json";
    const auto dispatch =
        are_gates_wanted
            ? any_dispatch()
            : std::function<void(config::Config&)>(dispatched_by(config::Dispatch::kThread));
    Environment environment = configured(preloaded(), gated_config(folder, dispatch), stats);
    if (is_tool_there) environment["LD_PRELOAD"] += ":" + placed(TOOL_STAND_IN_PATH);
    const Outcome outcome = run({placed(TWIN_PATH), "periods", "1"}, environment);
    CHECK(outcome.exit_status == 0);
    const std::string line =
        "urgengo: dispatch: compute-sanitizer is there, which may run kernels one at a time: "
        "launches wait in their threads";
    const auto lines = lines_of(outcome.err);
    INFO(outcome.err);
    CHECK(std::count(lines.begin(), lines.end(), line) == (is_tool_there && are_gates_wanted));
    const auto found = nlohmann::json::parse(read_text(stats), nullptr, false);
    REQUIRE(!found.is_discarded());
    CHECK((found.at("gates").at("closed") > 0) == (are_gates_wanted && !is_tool_there));
    // In their threads or behind gates, launches wait.
    const nlohmann::json& second = found.at("chains").at(1);
    CHECK((second.at("holds") > 0 || second.at("paced_ns") > 0));
}
