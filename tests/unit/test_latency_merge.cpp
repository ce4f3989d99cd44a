// SPDX-License-Identifier: Apache-2.0
//
// urgengo bench latency --merge: several runs are as one, and only such as belong together.
#include "tools/bench/measure/latency_merge.h"

#include <vector>

#include "tests/support/catch.h"
#include "tools/bench/commands/cmd_bench_latency.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;
using Bins = std::vector<std::pair<double, int>>;

/// As the library writes it, but for percentiles, which nobody may take over.
Json times(const Bins& bins, double max) {
    Json middles = Json::array(), counts = Json::array();
    int count = 0;
    double sum = 0;
    for (const auto& [middle, values] : bins) {
        middles.push_back(middle);
        counts.push_back(values);
        count += values;
        sum += middle * values;
    }
    return {{"count", count},      {"mean", count ? sum / count : 0},
            {"p50", -1},           {"p90", -1},
            {"p99", -1},           {"p99.99", -1},
            {"max", max},          {"bin_middles", middles},
            {"bin_counts", counts}};
}

Json results(int seed, const Bins& launches, double max) {
    const Json none = times({}, 0), some = times({{400, 3}}, 410);
    const Json instances = {{"count", 3},          {"launches", some},  {"decisions", some},
                            {"deciding_ns", some}, {"added_ns", some},  {"our_driver_ns", some},
                            {"held_ns", none},     {"polling_ns", none}};
    const Json launch = {
        {"added_ns", times(launches, max)}, {"held_ns", none}, {"driver_ns", some}};
    const Json own_time = {{"launches", 3},
                           {"own_ns", {{"median", 7}}},
                           {"calls", {{"launch", launch}}},
                           {"instances", instances}};
    const std::string number = std::to_string(seed);
    return {{"format_version", 1},
            {"program", "urgengo bench latency"},
            {"gpu", "G"},
            {"simulated_gpu", false},
            {"driver", "580"},
            {"version", "1"},
            {"commit", "c"},
            {"date_utc", "2026"},
            {"command_line", "latency " + number},
            {"parameters",
             {{"f_a", "0.9"}, {"seconds", "500"}, {"seed", number}, {"preset", "urgengo"}}},
            {"workload_hash", "w"},
            {"runs",
             {{{"f_a", 0.9},
               {"seed", seed},
               {"report", {{"overall_miss_ratio", 0.01 * seed}}},
               {"own_time", own_time}}}}};
}

Result<Json> merge(const std::vector<Json>& all) {
    std::vector<std::string> texts, files;
    for (const Json& one : all) {
        texts.push_back(one.dump());
        files.push_back(std::string(1, static_cast<char>('a' + files.size())) + ".json");
    }
    return merge_latencies(texts, files);
}

TEST_CASE("Merged latencies are those of all runs' calls", "[unit][cli]") {
    // Seed 2's counter ticked a little differently; the one in ten thousand is in seed 3.
    const auto merged =
        merge({results(1, {{100, 9000}, {200, 900}}, 210), results(3, {{100, 96}, {5000, 4}}, 4900),
               results(2, {{101, 9000}, {300, 1000}}, 310)});
    INFO((merged ? "" : merged.error()));
    REQUIRE(merged);
    const Json& run = merged->at("runs").at(0);
    CHECK(merged->at("runs").size() == 1);
    CHECK(run["seeds"] == Json({1, 3, 2}));
    CHECK(run["miss_ratios"].size() == 3);
    const Json& added = run["own_time"]["calls"]["launch"]["added_ns"];
    CHECK(added["count"] == 20'000);
    CHECK(added["max"] == 4900.0);
    CHECK(added["p50"] == 101.0);
    CHECK(added["p90"] == 101.0);  // 18,096 of 20,000 are no longer than that
    CHECK(added["p99"] == 300.0);
    CHECK(added["p99.99"] == 4900.0);  // of four in its bin, and never more than the maximum
    CHECK(added["mean"].get<double>() ==
          Approx((9096 * 100 + 900 * 200 + 9000 * 101 + 1000 * 300 + 4 * 5000) / 20'000.0));
    CHECK(added["bin_middles"] == Json({100.0, 101.0, 200.0, 300.0, 5000.0}));
    CHECK(added["bin_counts"] == Json({9096, 9000, 900, 1000, 4}));
    CHECK(run["own_time"]["instances"]["count"] == 9);
    CHECK(run["own_time"]["instances"]["added_ns"]["count"] == 9);
    CHECK(run["own_time"]["calls"]["launch"]["held_ns"]["count"] == 0);
    CHECK(format_latencies(run["own_time"])->find("20000") != std::string::npos);
    CHECK(merged->at("parameters")["merged"] == "3");
    CHECK(merged->at("command_line") == "latency 1; latency 3; latency 2");
}

TEST_CASE("Merged latencies merge again as if at once", "[unit][cli]") {
    const Json a = results(1, {{100, 9000}}, 110), b = results(2, {{200, 90}}, 210),
               c = results(3, {{150, 7}}, 160);
    const auto both = merge({a, b});
    REQUIRE(both);
    const auto again = merge({*both, c}), once = merge({a, b, c});
    INFO((again ? "" : again.error()));
    REQUIRE(again);
    CHECK(again->at("runs") == once->at("runs"));
    CHECK(merge({*both, a}).error() ==
          "b.json: found seed 1 at f_a 0.9 again, accepted: each once");
}

TEST_CASE("Merging latencies keeps loads apart", "[unit][cli]") {
    Json two = results(1, {{100, 10}}, 110);
    Json other = two["runs"][0];
    other["f_a"] = 1.1;
    two["runs"].push_back(other);
    const auto merged = merge({two});
    REQUIRE(merged);
    REQUIRE(merged->at("runs").size() == 2);
    CHECK(merged->at("runs")[1]["own_time"]["calls"]["launch"]["added_ns"]["count"] == 10);
}

TEST_CASE("Latencies of other conditions are not merged", "[unit][cli]") {
    const Json first = results(1, {{100, 10}}, 110);
    const auto refused = [&](const char* place, const Json& value) {
        Json second = results(2, {{100, 10}}, 110);
        second.at(Json::json_pointer(place)) = value;
        const auto merged = merge({first, second});
        return merged ? "" : merged.error();
    };
    const std::string same = ", accepted: the same as in a.json";
    CHECK(refused("/version", "2") == "b.json: version: found \"1\" and \"2\"" + same);
    CHECK(refused("/commit", "d") == "b.json: commit: found \"c\" and \"d\"" + same);
    CHECK(refused("/gpu", "H") == "b.json: gpu: found \"G\" and \"H\"" + same);
    CHECK(refused("/driver", "570") == "b.json: driver: found \"580\" and \"570\"" + same);
    CHECK(refused("/workload_hash", "v") == "b.json: workload_hash: found \"w\" and \"v\"" + same);
    CHECK(refused("/parameters/preset", "paper") ==
          "b.json: preset: found \"urgengo\" and \"paper\"" + same);
    CHECK(refused("/parameters/seconds", "9") == "b.json: seconds: found \"500\" and \"9\"" + same);
    CHECK(refused("/parameters/seed", "9").empty());
    CHECK(refused("/runs/0/seed", 1) ==
          "b.json: found seed 1 at f_a 0.9 again, accepted: each once");
    CHECK(refused("/program", "urgengo bench smoke") ==
          "b.json: program: found \"urgengo bench smoke\", accepted: \"urgengo bench latency\"");
    CHECK(refused("/runs", 5)
              .find("b.json: found no results of this version of `urgengo bench "
                    "latency` (") == 0);
    CHECK(refused("/runs/0/own_time/instances/added_ns", {{"count", 1}}) ==
          "b.json: found no histograms, accepted: results of a library that writes them (measure "
          "again)");
    CHECK(refused("/runs/0/own_time/calls", Json::object())
              .find("found own times that do not fit together: ") == 0);
    CHECK(merge_latencies({"nonsense"}, {"x.json"}).error().find("x.json: found no results") == 0);
}

}  // namespace
}  // namespace urgengo::cli
