// SPDX-License-Identifier: Apache-2.0
//
// What a context leaves in the host's memory when it has gone: with us, and without.
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;

namespace {

constexpr int kWarmUp = 100;  // more than are kept for late users (ProgressMarks::kKeptEnded)
constexpr int kContexts = 400;
constexpr int kLaunches = 4;  // of a frame; each context has one

using Change = std::function<void(config::Config&)>;

/// @returns what each context left in use, as the program says
double left_bytes(const Outcome& outcome) {
    INFO(outcome.err);
    REQUIRE(outcome.exit_status == 0);
    return std::stod(outcome.out) / kContexts;
}

std::filesystem::path write_config_for(const Folder& folder, const Change& change) {
    config::TaskProfile task;
    task.name = "work";
    task.kernels.assign(kLaunches, {"tiny", 4, 64, 10us, 0.1});
    task.segments = {{1us, kLaunches, kLaunches, kLaunches, "context"}};
    config::Profile profile;
    profile.chains = {{"one", {task}}};
    return write_config(folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
                        {chain("one", 60s, {{"work", "caller"}})}, &profile,
                        [&](config::Config& config) {
                            config.scheduler.progress.mark_every = 0ns;  // behind every launch
                            if (change) change(config);
                        });
}

/// There was something to leave: each context's frame was scheduled and marked.
void check_was_scheduled(const std::string& stats) {
    const auto root = nlohmann::json::parse(stats, nullptr, false);
    REQUIRE(!root.is_discarded());
    CHECK(root.at("tripped") == "");
    constexpr int kFrames = kWarmUp + kContexts;
    const auto& chain = root.at("chains").at(0);
    CHECK(chain.at("instances") == kFrames);
    CHECK(chain.at("launches") == kFrames * kLaunches);
    CHECK(chain.at("scheduled") == kFrames * kLaunches);
    CHECK(chain.at("marks").get<int>() >= kFrames);
}

/// @param how  contexts end: see the scenario
void check_leaves_little(const std::string& how, const Change& change = {}) {
    // What is known of a context stays, as pointers to it stand for that context for good: 132
    // bytes (MarkContext). When its mailbox stayed, too, it was 4.2 KB. The rest is malloc's.
    constexpr double kMostBytes = 192;
    const Folder folder;
    const auto stats = folder.path() / "stats.json";
    const std::vector<std::string> scenario{"context_memory", how, std::to_string(kWarmUp),
                                            std::to_string(kContexts)};
    const double alone = left_bytes(run_twin(scenario, bare()));
    const double with_us = left_bytes(
        run_twin(scenario, configured(preloaded(), write_config_for(folder, change), stats)));
    check_was_scheduled(read_text(stats));
    INFO(how << ": bytes that each context left in use: alone " << alone << ", with us "
             << with_us);
    CHECK(with_us - alone < kMostBytes);
}

}  // namespace

TEST_CASE("Contexts that come and go leave less than 0.2 KB in the host's memory",
          "[interposer][context]") {
    check_leaves_little("destroy");
    check_leaves_little("destroy", by_events);
    check_leaves_little("destroy", by_stream_pool);
    check_leaves_little("destroy", by_stream_attribute);
}

TEST_CASE("Primary contexts that are released or reset leave less than 0.2 KB",
          "[interposer][context]") {
    check_leaves_little("release");
    check_leaves_little("reset");
}
