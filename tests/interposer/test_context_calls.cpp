// SPDX-License-Identifier: Apache-2.0
//
// Calls that change which context is current: launches need no asking up to them, and again from
// the second one after them on. Calls that end one: they wait for its work.
#include <functional>
#include <nlohmann/json.hpp>
#include <utility>

#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"
#include "tools/trace/run_reader.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;

namespace {

/// Runs the scenario bare and as two chains, the second one's thread being "last", which must give
/// the same.
/// @returns what it said on stderr, and what the statistics say of the second chain
std::pair<std::string, nlohmann::json> last_chain(
    const std::vector<std::string>& scenario,
    const std::function<void(urgengo::config::Config&)>& change = {}) {
    const Folder folder;
    const auto stats = folder.path() / "stats.json";
    const auto config = write_config(
        folder.path() / "config.json", "urgengo", urgengo::config::Mode::kEnforce,
        {chain("one", 60s, {{"work", "first"}}), chain("two", 60s, {{"more", "last"}})}, nullptr,
        change);
    const Outcome alone = run_twin(scenario, bare());
    const Outcome outcome = run_twin(scenario, configured(preloaded(), config, stats));
    INFO(scenario.front() << ": " << outcome.err);
    REQUIRE(alone.exit_status == 0);
    CHECK(outcome.exit_status == 0);
    CHECK(outcome.out == alone.out);
    const auto root = nlohmann::json::parse(read_text(stats), nullptr, false);
    REQUIRE(!root.is_discarded());
    CHECK(root.at("tripped") == "");
    return {outcome.err, root.at("chains").at(1)};
}

/// @returns what the statistics say of the only chain, after a scenario with these arguments
nlohmann::json counted(const std::vector<std::string>& scenario) {
    const Folder folder;
    const auto stats = folder.path() / "stats.json";
    const auto config =
        write_config(folder.path() / "config.json", "urgengo", urgengo::config::Mode::kEnforce,
                     {chain("one", 60s, {{"work", "caller"}})});
    const Outcome outcome = run_twin(scenario, configured(preloaded(), config, stats));
    INFO(scenario.at(1) << " " << scenario.at(2) << ": " << outcome.err);
    REQUIRE(outcome.exit_status == 0);
    const auto root = nlohmann::json::parse(read_text(stats), nullptr, false);
    REQUIRE(!root.is_discarded());
    return root.at("chains").at(0);
}

/// @returns launches of the scenario that needed no asking
int as_planned(const char* call, const char* version) {
    const auto chain = counted({"context_call", call, version});
    CHECK(chain.at("launches") == 8);
    return chain.at("as_planned").get<int>();
}

}  // namespace

TEST_CASE("A launch behind a call that changes the context is asked about",
          "[interposer][context]") {
    const int undisturbed = as_planned("cuCtxGetCurrent", "4000");
    REQUIRE(undisturbed > 2);
    CHECK(as_planned("cuCtxSetCurrent", "4000") == undisturbed - 1);
    CHECK(as_planned("cuCtxPushCurrent", "2000") == undisturbed - 1);
    CHECK(as_planned("cuCtxPushCurrent", "4000") == undisturbed - 1);
    CHECK(as_planned("cuCtxPopCurrent", "2000") == undisturbed - 1);
    CHECK(as_planned("cuCtxPopCurrent", "4000") == undisturbed - 1);
    CHECK(as_planned("cuCtxDetach", "2000") < undisturbed);  // also as one that may end
    CHECK(as_planned("cuCtxCreate", "2000") == undisturbed - 1);
    CHECK(as_planned("cuCtxCreate", "3020") == undisturbed - 1);
    CHECK(as_planned("cuCtxCreate", "11040") == undisturbed - 1);
    CHECK(as_planned("cuCtxCreate", "12050") == undisturbed - 1);
}

TEST_CASE("Context is ended as one that takes its modules and waits for its work",
          "[interposer][context]") {
    const auto waits = [](const char* call, const char* version) {
        return counted({"context_ends", call, version}).at("implicit_syncs").get<int>();
    };
    CHECK(waits("cuCtxDestroy", "2000") == 1);
    CHECK(waits("cuCtxDestroy", "4000") == 1);
    CHECK(waits("cuCtxDetach", "2000") == 1);
}

TEST_CASE("Gates open before each call of a bystander's that would wait for them",
          "[interposer][context]") {
    constexpr int kCalls = 21;
    constexpr auto kForLong = std::chrono::hours(1), kNever = std::chrono::hours(24);
    const auto task = [](const char* kernel, std::chrono::nanoseconds time) {
        config::TaskProfile its;
        its.name = "work";
        its.kernels = {{kernel, 46, 1024, time, 1.0}};
        return its;
    };
    config::Profile profile;
    profile.chains = {{"tight", {task("slow", 200ms)}}, {"loose", {task("wide", 300us)}}};
    const Folder folder;
    const auto config =
        write_config(folder.path() / "config.json", "urgengo", config::Mode::kEnforce,
                     {chain("tight", 300ms, {{"work", ""}}), chain("loose", 3s, {{"work", ""}})},
                     &profile, [&](config::Config& c) {
                         dispatched_by(config::Dispatch::kHost)(c);
                         c.scheduler.hold.max_per_instance = kForLong;
                         c.scheduler.packing.share_slack = kNever;
                     });
    const auto stats = folder.path() / "stats.json";
    const Outcome alone = run_twin({"bystander_waits"}, bare());
    const std::string trace_file = folder.path("run.ugtrace");
    auto environment = configured(preloaded(), config, stats);
    environment["URGENGO_RUN_TRACE"] = trace_file;
    const Outcome outcome = run_twin({"bystander_waits"}, environment);
    INFO(outcome.err);
    REQUIRE(alone.exit_status == 0);
    CHECK(outcome.exit_status == 0);
    CHECK(outcome.out == alone.out);
    const auto root = nlohmann::json::parse(read_text(stats), nullptr, false);
    REQUIRE(!root.is_discarded());
    const auto gates = root.at("gates");
    INFO(gates.dump());
    CHECK(gates.at("closed") == kCalls + 1);  // once there is no call
    CHECK(gates.at("parks") == kCalls);
    CHECK(gates.at("most_park_us") >= gates.at("park_us"));
    CHECK(gates.at("most_parked_us") >= gates.at("most_park_us"));
    // Each with its times, one after the other.
    const auto run = trace::read_run(trace_file);
    REQUIRE(run);
    int parks = 0;
    std::int64_t before_ns = 0;
    for (const abi::RunRecord& record : run->records) {
        if (record.kind != abi::RunKind::kPark) continue;
        ++parks;
        CHECK(record.begin_ns >= before_ns);
        CHECK(record.time_ns > record.begin_ns);
        CHECK(record.park.opening_ns > 0);
        CHECK(record.park.gated <= 1);  // it may have become overdue, and so opened
        before_ns = record.time_ns;
    }
    CHECK(parks == kCalls);
}

TEST_CASE("Launches are scheduled when many contexts have come and gone", "[interposer][context]") {
    const std::function<void(urgengo::config::Config&)> kernels{};
    for (const auto& change :
         {kernels, decltype(kernels)(by_events), decltype(kernels)(by_stream_pool)}) {
        const auto [err, last] = last_chain({"many_contexts", "200"}, change);
        CHECK(err == "");
        CHECK(last.at("launches") == 9);
        CHECK(last.at("scheduled") == 9);
    }
}

TEST_CASE("Launches in too many contexts are not scheduled, which is said once",
          "[interposer][context]") {
    const auto [err, last] = last_chain({"live_contexts", "70"});
    CHECK(lines_of(err) == std::vector<std::string>{"urgengo: there are more than 64 contexts: "
                                                    "launches in the others are not scheduled"});
    CHECK(last.at("scheduled") == 9);
}
