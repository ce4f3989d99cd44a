// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/measure/bench_calls.h"

#include <nlohmann/json.hpp>

#include "tests/support/catch.h"

namespace urgengo::cli {
namespace {

constexpr char kTimes[] = R"({"benchmarks": [
    {"name": "pass_through/cuCtxGetDevice", "cpu_time": 2.5, "real_time": 99, "driver_calls": 1},
    {"name": "scheduled/by_hint/cuLaunchKernel/manual_time", "cpu_time": 150, "median_ns": 120.5,
     "driver_calls": 1.04}]})";

CallBench make_bench() {
    CallBench bench;
    bench.conditions = {{"bare", "."}, {"40 chains", "^scheduled/", 40}};
    bench.runs = {
        {{{"pass_through/x", {2, 1}}, {"scheduled/y", {5, 1}}},
         {{"pass_through/x", {4, 1}}, {"scheduled/y", {5, 1}}},
         {{"pass_through/x", {3, 1}}, {"scheduled/y", {5, 1}}}},
        {{{"scheduled/y", {205, 4}}}, {{"scheduled/y", {200, 4}}}, {{"scheduled/y", {210, 4}}}}};
    return bench;
}

std::string statistics(int launches, int scheduled, int holds) {
    const nlohmann::json chain = {
        {"name", "measured"}, {"launches", launches}, {"scheduled", scheduled}, {"holds", holds}};
    return nlohmann::json{{"chains", {chain}}}.dump();
}

}  // namespace

TEST_CASE("Call times are read from Google Benchmark's JSON", "[cli][bench_calls]") {
    const auto times = parse_call_times(kTimes, "times.json");
    REQUIRE(times);
    CHECK(times->size() == 2);
    // Processor time where the loop is timed as a whole, the frames' median where there are frames.
    CHECK(times->at("pass_through/cuCtxGetDevice").ns == 2.5);
    CHECK(times->at("scheduled/by_hint/cuLaunchKernel").ns == 120.5);
    CHECK(times->at("scheduled/by_hint/cuLaunchKernel").driver_calls == 1.04);
}

TEST_CASE("Call times that cannot be read name the file and the reason", "[cli][bench_calls]") {
    const auto error_of = [](const char* text) {
        const auto times = parse_call_times(text, "times.json");
        REQUIRE_FALSE(times);
        return times.error();
    };
    CHECK(error_of("") ==
          "times.json: found no list of benchmarks, accepted: Google Benchmark's JSON");
    CHECK(error_of(R"({"benchmarks": []})") == "times.json: found no benchmark in it");
    CHECK(error_of(R"({"benchmarks": [{"name": "a"}]})") ==
          "times.json: found a benchmark without name or cpu_time");
    CHECK(error_of(R"({"benchmarks": [{"name": "a", "error_occurred": true,
                       "error_message": "no"}]})") == "times.json: a failed: no");
}

TEST_CASE("Launches that an NVTX tool was not told of are told from those that it was",
          "[cli][bench_calls]") {
    const auto times = parse_call_times(
        R"({"benchmarks": [{"name": "a", "cpu_time": 1, "nvtx_calls": 0.03},
                           {"name": "b", "cpu_time": 1, "nvtx_calls": 3}]})",
        "times.json");
    REQUIRE(times);
    CHECK(times->at("a").nvtx_calls == 0.03);
    CHECK(why_not_told(*times) == "");
    CallTimes silent = *times;
    silent["b"].nvtx_calls = 0;
    CHECK(why_not_told(silent) == "b makes no call of the NVTX tool, accepted: some in each frame");
}

TEST_CASE("Own time is the time with UrgenGo less the bare median", "[cli][bench_calls]") {
    const CallBench bench = make_bench();
    CHECK(bench.driver_ns("pass_through/x").median == 3);
    const Spread own = bench.own_ns("scheduled/y", 1);
    CHECK(own.median == 200);
    CHECK(own.min == 195);
    CHECK(own.max == 205);
    CHECK(bench.driver_calls("scheduled/y", 1) == 4);
}

TEST_CASE("The call table says which goals are met", "[cli][bench_calls]") {
    CallBench bench = make_bench();
    CHECK(format_call_table(bench).find("NOT MET") == std::string::npos);
    for (CallTimes& times : bench.runs[1]) times["scheduled/y"].ns += 1;
    CHECK(format_call_table(bench).find("NOT MET") != std::string::npos);
}

TEST_CASE("Launches that were held or not scheduled are told from free ones",
          "[cli][bench_calls]") {
    CHECK(why_not_scheduled(statistics(7, 7, 0), "measured") == "");
    CHECK(why_not_scheduled(statistics(7, 6, 0), "measured") == "6 of 7 launches were scheduled");
    CHECK(why_not_scheduled(statistics(7, 7, 1), "measured") == "1 launches were held");
    CHECK(why_not_scheduled(statistics(0, 0, 0), "measured") ==
          "UrgenGo saw no launch of chain measured");
    CHECK(why_not_scheduled(statistics(7, 7, 0), "other") ==
          "UrgenGo's statistics know no chain other");
    CHECK(why_not_scheduled("", "measured") == "UrgenGo wrote no statistics");
}

TEST_CASE("Launches without marks behind them are told from marked ones", "[cli][bench_calls]") {
    CHECK(why_not_marked({{"scheduled/x", {180, 4}}, {"scheduled/y", {180, 4}}}) == "");
    CHECK(why_not_marked({{"scheduled/x", {180, 4}}, {"scheduled/y", {45, 1.1}}}) ==
          "scheduled/y makes 1.10 driver calls, accepted: at least 2");
}

TEST_CASE("The call bench's JSON keeps every round", "[cli][bench_calls]") {
    const auto json = nlohmann::json::parse(to_json(make_bench()));
    CHECK(json["conditions"][0]["calls"]["pass_through/x"]["ns"] == nlohmann::json({2, 4, 3}));
    CHECK(json["conditions"][1]["calls"]["scheduled/y"]["own_ns"] == 200);
    CHECK(json["conditions"][1]["chains"] == 40);
}

}  // namespace urgengo::cli
