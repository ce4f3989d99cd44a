// SPDX-License-Identifier: Apache-2.0
#include "host/observe/statistics.h"

#include <nlohmann/json.hpp>

#include "tests/support/catch.h"

using namespace urgengo::observe;

TEST_CASE("Statistics give the mean over chains of their miss ratios", "[observe][statistics]") {
    ChainStatistics a, b, idle;
    a.name = "a", a.instances = 10, a.finished = 10, a.missed = 1;
    b.name = "b", b.instances = 100, b.finished = 100, b.missed = 50, b.exited = 20;
    b.latency_sum_ns = 80 * 2'000'000;
    b.resyncs = 3, b.observed = 4, b.unknown = 5, b.implicit_syncs = 6, b.copies_cut = 7;
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
    b.late_starts = 3;
    CHECK(json["chains"][0]["guard"] == "off");
    CHECK(json["guard"] == "");
    CHECK(nlohmann::json::parse(to_json({}, "enforce", "", "guard: fell"))["guard"] ==
          "guard: fell");
    CHECK(to_table({&a}, "enforce", "guard: fell").ends_with("%\nguard: fell\n"));
    const std::string table = to_table({&a, &b, &idle}, "enforce");
    CHECK(table.find("frames that started late: b 3\n") != std::string::npos);
    CHECK(table.find("overall deadline miss ratio 30.00 %") != std::string::npos);
}
