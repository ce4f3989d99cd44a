// SPDX-License-Identifier: Apache-2.0
//
// Counting instances, the deadline miss ratio, and the report's two forms.
#include <nlohmann/json.hpp>
#include <numeric>

#include "tests/support/catch.h"
#include "tools/chains/frame_queue.h"
#include "tools/chains/report.h"
#include "tools/chains/scenario.h"

using namespace urgengo::chains;
using namespace std::chrono_literals;

namespace {

RunReport sample_report() {
    RunReport report;
    report.gpu = "Some GPU";
    report.urgengo = "scheduling";
    report.results = "ok";
    report.parameters = {{"f_a", "0.9"}};
    report.start = 5s;
    ChainReport chain;
    chain.name = "C0";
    summarize(chain, {{0ms, 50ms, Outcome::kOnTime},
                      {150ms, 280ms, Outcome::kLate, 77, 160ms, 161ms},
                      {300ms, 0ms, Outcome::kExited, 77, 302ms, 303ms},
                      {450ms, 0ms, Outcome::kDropped},
                      {600ms, 0ms, Outcome::kNotRun}});
    report.chains.push_back(chain);
    chain.name = "C1";
    summarize(chain, {{0ms, 20ms, Outcome::kOnTime}});
    report.chains.push_back(chain);
    chain.name = "C2";
    summarize(chain, {{0ms, 0ms, Outcome::kNotRun}});
    report.chains.push_back(chain);
    return report;
}

}  // namespace

TEST_CASE("summarize counts late, exited and dropped instances as missed", "[unit][chains]") {
    const ChainReport chain = sample_report().chains[0];
    CHECK(chain.instances == 4);
    CHECK(chain.missed == 3);
    CHECK(chain.exited == 1);
    CHECK(chain.dropped == 1);
    CHECK(chain.miss_ratio() == Approx(0.75));
    REQUIRE(chain.latency);
    CHECK(chain.latency->p50_ms == Approx(50));
    CHECK(chain.latency->max_ms == Approx(130));
    CHECK(chain.latency->mean_ms == Approx(90));
}

TEST_CASE("overall_miss_ratio is the mean over chains that ran", "[unit][chains]") {
    CHECK(sample_report().overall_miss_ratio() == Approx((0.75 + 0) / 2));
    CHECK(RunReport{}.overall_miss_ratio() == 0);
}

TEST_CASE("instances_per_s counts what was completed while frames arrived", "[unit][chains]") {
    RunReport report = sample_report();
    CHECK(report.instances_per_s() == 0);
    report.arrivals_for = 500ms;
    CHECK(report.finished_in_time() == 3);
    CHECK(report.instances_per_s() == Approx(6));
    report.arrivals_for = 100ms;  // the late one ends after that
    CHECK(report.finished_in_time() == 2);
    const auto json = nlohmann::json::parse(format_json(report, false));
    CHECK(json["throughput"]["finished"] == 2);
    CHECK(json["throughput"]["instances_per_s"] == Approx(20));
}

TEST_CASE("format_json has no number for a deadline that there is not", "[unit][chains]") {
    RunReport report = sample_report();
    report.chains[0].deadline_ms = Scenario{1, 1, {"C0"}, false}.deadline_ms({"C0", 150, 120, {}});
    CHECK(nlohmann::json::parse(format_json(report, false))["chains"][0]["deadline_ms"].is_null());
}

TEST_CASE("percentile takes the nearest rank", "[unit][chains]") {
    std::vector<double> values(20);
    std::iota(values.begin(), values.end(), 1.0);
    CHECK(percentile(values, 0.50) == 10);
    CHECK(percentile(values, 0.95) == 19);
    CHECK(percentile(values, 0.99) == 20);
    CHECK(percentile({7}, 0.01) == 7);
}

TEST_CASE("format_table shows every chain and the overall ratio", "[unit][chains]") {
    const std::string table = format_table(sample_report());
    const auto contains = [&](const char* part) { return table.find(part) != std::string::npos; };
    CHECK(contains("\nC0 "));
    CHECK(contains(" 75.0 "));
    CHECK(contains("UrgenGo: scheduling"));
    CHECK(contains("\noverall deadline miss ratio: 37.50 %\n"));
}

TEST_CASE("format_json holds the records only when asked", "[unit][chains]") {
    const auto brief = nlohmann::json::parse(format_json(sample_report(), false));
    CHECK(brief.at("overall_miss_ratio").get<double>() == Approx(0.375));
    CHECK(brief.at("parameters").at("f_a") == "0.9");
    CHECK(brief.at("kernel_driver_version").is_null());
    CHECK_FALSE(brief["chains"][0].contains("records"));
    CHECK(brief["chains"][2].at("latency_ms").is_null());

    const auto full = nlohmann::json::parse(format_json(sample_report(), true));
    const auto& records = full["chains"][0].at("records");
    REQUIRE(records.size() == 4);
    CHECK(records[1].at("outcome") == "late");
    CHECK(records[1].at("latency_ms").get<double>() == Approx(130));
    CHECK(records[1].at("arrival_ns") == 5'150'000'000);
    CHECK(records[1].at("thread") == 77);
    CHECK(records[1].at("begin_ns") == 5'160'000'000);
    CHECK(records[1].at("first_launched_ns") == 5'161'000'000);
    CHECK(records[1].at("end_ns") == 5'280'000'000);
    CHECK(records[2].at("outcome") == "exited");
    CHECK(records[2].at("begin_ns") == 5'302'000'000);
    CHECK_FALSE(records[2].contains("end_ns"));
    CHECK(records[3].at("outcome") == "dropped");
    CHECK_FALSE(records[3].contains("begin_ns"));
}

TEST_CASE("FrameQueue keeps every frame in order when not asked for the latest", "[unit][chains]") {
    FrameQueue<int> queue(false);
    CHECK_FALSE(queue.push(1));
    CHECK_FALSE(queue.push(2));
    queue.close();
    CHECK(queue.pop() == 1);
    CHECK(queue.pop() == 2);
    CHECK(queue.pop() == std::nullopt);
}

TEST_CASE("FrameQueue gives back the overtaken frame when it keeps the latest", "[unit][chains]") {
    FrameQueue<int> queue(true);
    CHECK_FALSE(queue.push(1));
    CHECK(queue.push(2) == 1);
    CHECK(queue.pop() == 2);
    CHECK_FALSE(queue.push(3));
}

TEST_CASE("Both forms of a report tell how long a disturber's calls took, if there was one",
          "[unit][chains]") {
    RunReport report = sample_report();
    CHECK_FALSE(nlohmann::json::parse(format_json(report, false)).contains("disturber"));
    CHECK(format_table(report).find("disturber") == std::string::npos);
    report.disturber = {{"cuMemFree", 12, 3.5, 40, 41}};
    const auto calls = nlohmann::json::parse(format_json(report, false)).at("disturber");
    REQUIRE(calls.size() == 1);
    CHECK(calls[0].at("call") == "cuMemFree");
    CHECK(calls[0].at("count") == 12);
    CHECK(calls[0].at("p50_us") == 3.5);
    CHECK(calls[0].at("max_us") == 41);
    CHECK(format_table(report).find("cuMemFree") != std::string::npos);
}
