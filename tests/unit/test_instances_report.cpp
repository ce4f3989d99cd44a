// SPDX-License-Identifier: Apache-2.0
//
// The counts of instance detection, as a table and as JSON.
#include <nlohmann/json.hpp>

#include "tests/support/catch.h"
#include "tools/bench/measure/instances_report.h"

using namespace urgengo::cli;

namespace {

InstancesLevel sample_level() {
    InstancesLevel level;
    level.f_a = 0.9;
    level.miss_pct = {12.5};
    InstanceMatch& match = level.chains["C0"];
    match.frames = 200;
    match.detected = 100;
    match.false_starts = 1;
    match.missed_starts = 2;
    match.merged = 3;
    match.resyncs = 4;
    match.observed = 5;
    match.begin_error_us = {-9, 1, 2, 3};
    level.chains["C1"].frames = 200;
    return level;
}

}  // namespace

TEST_CASE("Errors are summed up by median, 95th percentile and maximum", "[unit][cli]") {
    const ErrorSummary four = summarize_errors({3, -9, 1, 2});
    CHECK(four.median_us == 1.5);
    CHECK(four.p95_abs_us == 9);
    CHECK(four.max_abs_us == 9);
    std::vector<double> twenty(20, -1);
    twenty[3] = 100;
    CHECK(summarize_errors(twenty).median_us == -1);
    CHECK(summarize_errors(twenty).p95_abs_us == 1);
    CHECK(summarize_errors(twenty).max_abs_us == 100);
    CHECK(summarize_errors({}).max_abs_us == 0);
}

TEST_CASE("Instances are a table with shares of the true ones", "[unit][cli]") {
    CHECK(format_instances(sample_level()) ==
          "f_a 0.9  true  detected  false starts  missed starts      merged     resyncs  observed "
          "only      begin  end  arrival\n"
          "C0        200       100    1 (0.50 %)     2 (1.00 %)  3 (1.50 %)  4 (4.00 %)     5 "
          "(5.00 %)  2 / 9 / 9    -        -\n"
          "C1        200         0    0 (0.00 %)     0 (0.00 %)  0 (0.00 %)  0 (0.00 %)     0 "
          "(0.00 %)          -    -        -\n"
          "all       400       100    1 (0.25 %)     2 (0.50 %)  3 (0.75 %)  4 (4.00 %)     5 "
          "(5.00 %)  2 / 9 / 9    -        -\n");
}

TEST_CASE("Instances are JSON with counts and shares", "[unit][cli]") {
    const auto json = instances_json(sample_level());
    CHECK(json["f_a"] == 0.9);
    CHECK(json["overall_miss_pct"][0] == 12.5);
    CHECK(json["overall"]["true_instances"] == 400);
    CHECK(json["overall"]["false_starts"]["pct"] == 0.25);
    const auto& chain = json["chains"][0];
    CHECK(chain["name"] == "C0");
    CHECK(chain["missed_starts"]["count"] == 2);
    CHECK(chain["merged"]["pct"] == 1.5);
    CHECK(chain["resyncs"]["pct"] == 4);
    CHECK(chain["observed"]["count"] == 5);
    CHECK(chain["begin_error"]["max_abs_us"] == 9);
    CHECK(chain["begin_error"]["instances"] == 4);
    CHECK(chain["end_error"].is_null());
}
