// SPDX-License-Identifier: Apache-2.0
#include "host/observe/statistics.h"

#include <nlohmann/json.hpp>

#include "tests/support/catch.h"

using namespace urgengo::observe;

TEST_CASE("Statistics give the mean over chains of their miss ratios", "[observe][statistics]") {
    ChainStatistics a, b, idle;
    a.name = "a", a.frames.instances = 10, a.frames.finished = 10, a.frames.missed = 1;
    b.name = "b", b.frames.instances = 100, b.frames.finished = 100, b.frames.missed = 50,
    b.frames.exited = 20;
    b.frames.latency_sum_ns = 80 * 2'000'000;
    b.frames.resyncs = 3, b.frames.observed = 4, b.tasks.unknown = 5, b.tasks.implicit_syncs = 6,
    b.copies_cut = 7;
    b.synchronisations = 7;
    idle.name = "idle";
    const auto json = nlohmann::json::parse(to_json({&a, &b, &idle}, "enforce", ""));
    // Not 51 of 110; a chain without frames has no ratio.
    CHECK(json["overall_miss_ratio"].get<double>() == Approx(0.3));
    CHECK(json["chains"][1]["latency_mean_ms"].get<double>() == Approx(2.0));
    CHECK(json["chains"][1]["resyncs"] == 3);
    CHECK(json["chains"][1]["observed"] == 4);
    CHECK(json["chains"][1]["unknown"] == 5);
    CHECK(json["chains"][1]["implicit_syncs"] == 6);
    CHECK(json["chains"][1]["copies_cut"] == 7);
    CHECK(json["chains"][1]["synchronisations"] == 7);
    CHECK(json["chains"][1]["stood_aside"] == 0);
    b.frames.late_starts = 3;
    a.frames.stood_aside = 2, b.frames.stood_aside = 9;
    CHECK(nlohmann::json::parse(to_json({&b}, "enforce", ""))["chains"][0]["stood_aside"] == 9);
    CHECK(json["chains"][0]["guard"] == "off");
    CHECK(json["guard"] == "");
    CHECK(nlohmann::json::parse(to_json({}, "enforce", "", "guard: fell"))["guard"] ==
          "guard: fell");
    CHECK(to_table({&a}, "enforce", "guard: fell").ends_with("%\nguard: fell\n"));
    CHECK(json["chains"][0]["guard_found"].is_null());
    a.guard_found = {"priorities", {1, 0.5, 0.25, 0, 0}};
    b.guard_found = {"observe", {4, 0.25, 0.5, 0.125, 0.375}};
    const auto found = nlohmann::json::parse(to_json({&a, &b}, "enforce", ""))["chains"];
    CHECK(found[0]["guard_found"] ==
          nlohmann::json{{"with", "priorities"}, {"pairs", 1}, {"usual", 0.5}, {"other", 0.25}});
    CHECK(found[1]["guard_found"]["high"] == 0.375);
    CHECK(to_table({&a, &b}, "enforce", "guard: fell")
              .ends_with("guard: mean lateness of a: 0.50 as it was, 0.25 with priorities\n"
                         "guard: mean lateness of b: 0.25 as it was, 0.50 with observe "
                         "(+0.12..+0.38, 95 %)\n"));
    a.guard_found = b.guard_found = {};
    const std::string table = to_table({&a, &b, &idle}, "enforce");
    CHECK(table.find("frames that started late: b 3\n") != std::string::npos);
    CHECK(table.find("launching was all that they waited for: a 2, b 9\n") != std::string::npos);
    CHECK(table.find("overall deadline miss ratio 30.00 %") != std::string::npos);
}

TEST_CASE("Statistics of a chain whose name is not UTF-8 are JSON", "[observe][statistics]") {
    ChainStatistics chain;
    chain.name = "lid\xe4r";
    const auto json = nlohmann::json::parse(to_json({&chain}, "enforce", ""));
    CHECK(json["chains"][0]["name"] == "lid\ufffdr");
}

TEST_CASE("Statistics tell why frames were late", "[observe][statistics]") {
    ChainStatistics lidar, camera;
    lidar.name = "lidar", camera.name = "camera";
    lidar.causes = {{MissCause::kHeld, "camera", 9}, {MissCause::kGpuLonger, "", 3}};
    const auto json = nlohmann::json::parse(to_json({&lidar, &camera}, "enforce", ""));
    const auto& causes = json["chains"][0]["causes"];
    REQUIRE(causes.size() == 2);
    CHECK(causes[0] == nlohmann::json{{"cause", "held"}, {"behind", "camera"}, {"frames", 9}});
    CHECK(causes[1] == nlohmann::json{{"cause", "gpu_longer"}, {"behind", ""}, {"frames", 3}});
    CHECK(json["chains"][1]["causes"].empty());
    const std::string table = to_table({&lidar, &camera}, "enforce");
    CHECK(table.find("late frames of lidar: 9 held behind camera, 3 GPU longer than profiled\n") !=
          std::string::npos);
    CHECK(table.find("late frames of camera") == std::string::npos);
}
