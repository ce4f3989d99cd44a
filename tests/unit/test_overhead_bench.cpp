// SPDX-License-Identifier: Apache-2.0
//
// urgengo bench overhead: reading what the measuring library wrote, and how it grows with chains.
#include "tools/bench/measure/overhead_bench.h"

#include "tests/support/catch.h"
#include "tools/bench/commands/cmd_bench_latency.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

Json times(double ns, int count = 10) {
    return {{"count", count}, {"mean", ns},       {"p50", ns / 2}, {"p90", 2 * ns},
            {"p99", 3 * ns},  {"p99.99", 4 * ns}, {"max", 5 * ns}};
}

Json own_time() {
    const Json call = {{"added_ns", times(100)}, {"held_ns", times(0, 0)}};
    return {{"calls", {{"launch", call}, {"sync", call}}},
            {"instances",
             {{"count", 10},
              {"launches", times(400)},
              {"decisions", times(300)},
              {"deciding_ns", times(20'000)},
              {"added_ns", times(50'000)},
              {"our_driver_ns", times(10'000)},
              {"held_ns", times(3e6)},
              {"polling_ns", times(7000)}}}};
}

OverheadPoint point(int chains, double us) {
    OverheadRun run;
    run.launches = 400;
    run.deciding_us = us;
    return {chains, {run}};
}

TEST_CASE("Overhead is read from what the library measured", "[unit][cli]") {
    const auto run = parse_own_time(own_time());
    REQUIRE(run);
    CHECK(run->instances == 10);
    CHECK(run->deciding_us == Approx(20));
    CHECK(run->deciding_median_us == Approx(10));
    CHECK(run->deciding_ns_a_launch() == Approx(50));
    CHECK(run->added_ns_a_launch() == Approx(125));
    CHECK(run->held_us == Approx(3000));
    CHECK(!parse_own_time(Json::object()));
    Json none = own_time();
    none["instances"]["launches"]["mean"] = 0;
    CHECK(!parse_own_time(none));
}

TEST_CASE("Overhead that grows in proportion has exponent 1", "[unit][cli]") {
    const auto linear = fit({point(1, 2), point(10, 20), point(40, 80)}, &OverheadRun::deciding_us);
    CHECK(linear.us_a_chain == Approx(2));
    CHECK(linear.us_at_none == Approx(0).margin(1e-9));
    CHECK(linear.r_squared == Approx(1));
    CHECK(linear.exponent == Approx(1));
    const auto square =
        fit({point(1, 1), point(10, 100), point(40, 1600)}, &OverheadRun::deciding_us);
    CHECK(square.exponent == Approx(2));
}

TEST_CASE("Overhead is judged at twenty chains", "[unit][cli]") {
    const auto text = format_overhead({point(1, 1), point(20, 17.5)});
    CHECK(text.find("NOT MET") != std::string::npos);
    CHECK(format_overhead({point(1, 18), point(20, 16)}).find("NOT MET") == std::string::npos);
    CHECK(format_overhead({point(20, 16)}).find("R^2") == std::string::npos);  // no line of one
}

TEST_CASE("Latencies are shown of kinds of calls that there were", "[unit][cli]") {
    const auto text = format_latencies(own_time());
    REQUIRE(text);
    CHECK(text->find("launch: added") != std::string::npos);
    CHECK(text->find("launch: held") == std::string::npos);
    CHECK(text->find("instance: held") != std::string::npos);
    CHECK(text->find("12000.00") != std::string::npos);  // 4 times 3 ms
    CHECK(!format_latencies(Json::object()));
}

}  // namespace
}  // namespace urgengo::cli
