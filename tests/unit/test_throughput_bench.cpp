// SPDX-License-Identifier: Apache-2.0
//
// urgengo bench throughput: rates over rounds, and what they are compared with.
#include "tools/bench/measure/throughput_bench.h"

#include "tests/support/catch.h"

namespace urgengo::cli {
namespace {

ThroughputLevel sample() {
    return {4, {"bare", "vanilla", "urgengo"}, {{50, 40, 44}, {40, 20, 42}, {30, 22, 42}}};
}

TEST_CASE("Throughput is compared with vanilla, round by round", "[unit][cli]") {
    const ThroughputLevel level = sample();
    REQUIRE(base_row(level) == 1);
    CHECK(level.of(2).median == 30);
    const Spread ratio = level.ratio(2, 1);
    CHECK(ratio.min == Approx(0.75));
    CHECK(ratio.median == Approx(1.0));  // not that of the medians, 30 / 40
    CHECK(ratio.max == Approx(1.1));
    const auto json = throughput_json(level);
    CHECK(json["ratio_to"] == "vanilla");
    CHECK(json["rows"][2]["ratio"]["median"] == Approx(1.0));
    CHECK(json["rows"][0]["rounds"].size() == 3);
    CHECK(format_throughput(level).find("1.0000 (0.7500..1.1000)") != std::string::npos);
}

TEST_CASE("Throughput is compared with the first row without vanilla", "[unit][cli]") {
    ThroughputLevel level = sample();
    level.rows[1] = "edf";
    CHECK(base_row(level) == 0);
}

}  // namespace
}  // namespace urgengo::cli
