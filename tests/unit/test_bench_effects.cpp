// SPDX-License-Identifier: Apache-2.0
//
// urgengo bench: how sure a difference between rows is, and results of several invocations.
#include <cmath>
#include <nlohmann/json.hpp>

#include "tests/support/catch.h"
#include "tools/bench/smoke/bench_effects.h"
#include "tools/bench/smoke/bench_json.h"
#include "tools/bench/smoke/bench_merge.h"
#include "tools/bench/smoke/bench_table.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

/// Two chains, ten frames in each of ten blocks.
/// @param missed  in each block, of the first chain
RunResult run_of(const std::string& row, std::uint32_t seed, std::vector<unsigned> missed) {
    RunResult run;
    run.row = row;
    run.f_a = 0.9;
    run.seed = seed;
    run.gpu = "G";
    run.driver = "CUDA 13.0";
    run.cpu_cores = 1;
    run.chains = {{"C0", 42, 0, {}}, {"C1", 42, 0, {}}};
    double sum = 0;
    for (int block = 0; block < 10; ++block) {
        const unsigned count = missed[static_cast<std::size_t>(block) % missed.size()];
        sum += count;
        run.chains[0].blocks.push_back({10, count});
        run.chains[1].blocks.push_back({10, 0});
    }
    run.chains[0].miss_pct = sum;
    run.miss_pct = sum / 2;
    run.report =
        Json{{"gpu", "G"},
             {"cuda_driver_version", "13.0"},
             {"urgengo", "scheduling"},
             {"overall_miss_ratio", run.miss_pct / 100},
             {"cpu_cores", 1},
             {"chains",
              {{{"name", "C0"}, {"deadline_ms", 42}, {"miss_ratio", sum / 100}, {"exited", 0}},
               {{"name", "C1"}, {"deadline_ms", 42}, {"miss_ratio", 0}, {"exited", 0}}}}}
            .dump();
    return run;
}

BenchResults results_of(std::vector<std::string> rows, std::vector<RunResult> runs) {
    BenchResults results;
    results.gpu_line = "GPU: G";
    results.version = "1";
    results.commit = "abc";
    results.workload_hash = "0123";
    results.parameters = {{"seed", "1"}, {"seconds", "10"}};
    results.rows = std::move(rows);
    results.levels = {0.9};
    results.runs = std::move(runs);
    return results;
}

bool is(double a, double b) {
    return std::abs(a - b) < 1e-9;
}

TEST_CASE("Rows that lose the same frames differ by nothing, for sure", "[unit][cli]") {
    // Blocks differ much, rows do not: what is common to them is no doubt about the difference.
    const std::vector<unsigned> missed{0, 9, 1, 8};
    std::vector<unsigned> one_more = missed;
    for (unsigned& count : one_more) ++count;
    const auto list =
        effects(results_of({"bare", "urgengo", "urgengo+sync"},
                           {run_of("bare", 1, {10}), run_of("urgengo", 1, missed),
                            run_of("urgengo+sync", 1, one_more), run_of("bare", 2, {10}),
                            run_of("urgengo", 2, missed), run_of("urgengo+sync", 2, one_more)}));
    REQUIRE(list.size() == 3);
    CHECK(is(list[0].miss_pct.value, 50));
    CHECK(is(list[0].miss_pct.low, 50));
    CHECK(list[1].row == "urgengo");
    CHECK_FALSE(list[1].difference);
    CHECK(list[1].miss_pct.low < list[1].miss_pct.value - 5);
    CHECK(list[1].miss_pct.high > list[1].miss_pct.value + 5);
    REQUIRE(list[2].difference);
    CHECK(is(list[2].difference->value, 5));
    CHECK(is(list[2].difference->low, 5));
    CHECK(is(list[2].difference->high, 5));
}

TEST_CASE("Runs that differ widen the interval as blocks do", "[unit][cli]") {
    const auto one = effects(results_of({"urgengo"}, {run_of("urgengo", 1, {2})}));
    CHECK(is(one.at(0).miss_pct.high - one.at(0).miss_pct.low, 0));
    const auto two =
        effects(results_of({"urgengo"}, {run_of("urgengo", 1, {2}), run_of("urgengo", 2, {8})}));
    CHECK(is(two.at(0).miss_pct.value, 25));
    CHECK(is(two.at(0).miss_pct.low, 10));
    CHECK(is(two.at(0).miss_pct.high, 40));
}

TEST_CASE("Nothing is said of how sure it is when runs do not tell", "[unit][cli]") {
    BenchResults results = results_of({"urgengo"}, {run_of("urgengo", 1, {2})});
    CHECK(format_table(results).find("mean [95 %]  ") != std::string::npos);
    CHECK(format_table(results).find("10.0 [10.0, 10.0]") != std::string::npos);
    for (ChainResult& chain : results.runs[0].chains) chain.blocks.clear();
    CHECK(effects(results).empty());
    CHECK(format_table(results).find("[95 %]") == std::string::npos);
}

TEST_CASE("A report that lists every instance tells blocks of a second", "[unit][cli]") {
    const auto run = parse_report(
        R"({"gpu":"G","cuda_driver_version":"13.0","urgengo":"off","overall_miss_ratio":0.25,
"cpu_cores":1.5,"chains":[
{"name":"C0","deadline_ms":42,"miss_ratio":0.5,"exited":3,"records":[
{"outcome":"late","arrival_ns":7000000000},{"outcome":"on_time","arrival_ns":7999999999},
{"outcome":"dropped","arrival_ns":9000000000}]},
{"name":"C1","deadline_ms":90,"miss_ratio":0,"exited":1,"records":[
{"outcome":"on_time","arrival_ns":8000000000}]}]})",
        "r.json");
    INFO((run ? "" : run.error()));
    REQUIRE(run);
    REQUIRE(run->chains[0].blocks.size() == 3);
    CHECK(run->num_blocks() == 3);
    CHECK(run->chains[0].blocks[0].frames == 2);
    CHECK(run->chains[0].blocks[0].missed == 1);
    CHECK(run->chains[0].blocks[1].frames == 0);
    CHECK(run->chains[0].blocks[2].missed == 1);
    CHECK(run->chains[1].blocks[1].frames == 1);
    BenchResults results = results_of({"urgengo"}, {*run});
    const Json json = Json::parse(to_json(results));
    CHECK(json["runs"][0]["blocks_of_chains"][0]["frames"] == Json({2, 0, 1}));
    CHECK_FALSE(json["runs"][0]["report"]["chains"][0].contains("records"));
}

TEST_CASE("Merged results are those of one bench", "[unit][cli]") {
    const std::vector<std::string> rows{"urgengo", "urgengo+sync"};
    const auto part = [&](std::uint32_t seed, unsigned missed) {
        return results_of(
            rows, {run_of("urgengo", seed, {missed}), run_of("urgengo+sync", seed, {missed + 1})});
    };
    BenchResults whole = part(1, 2);
    for (const RunResult& run : part(2, 8).runs) whole.runs.push_back(run);
    BenchResults second = part(2, 8);
    second.parameters[0].second = "2";
    const auto merged = merge_results({to_json(part(1, 2)), to_json(second)}, {"a", "b"});
    INFO((merged ? "" : merged.error()));
    REQUIRE(merged);
    CHECK(format_table(*merged) == format_table(whole));
    CHECK(Json::parse(to_json(*merged))["effects"] == Json::parse(to_json(whole))["effects"]);
    const auto more = merge_results({to_json(*merged), to_json(part(3, 5))}, {"c", "d"});
    INFO((more ? "" : more.error()));
    REQUIRE(more);
    CHECK(more->runs.size() == 6);

    const auto refused = [&](const BenchResults& other) {
        const auto result = merge_results({to_json(part(1, 2)), to_json(other)}, {"a", "b"});
        return result ? "merged" : result.error();
    };
    CHECK(refused(part(1, 2)) == "found urgengo at f_a 0.9, seed 1 twice, accepted: once");
    BenchResults other = part(2, 8);
    other.runs.pop_back();
    CHECK(refused(other) ==
          "found no urgengo+sync at f_a 0.9, seed 2, accepted: all rows of a seed");
    other = part(2, 8);
    other.workload_hash = "4567";
    CHECK(refused(other) ==
          "b: workload_hash: found \"0123\" and \"4567\", accepted: the same as in a");
    other = part(2, 8);
    other.parameters[1].second = "12";
    CHECK(refused(other) == "b: seconds: found \"10\" and \"12\", accepted: the same as in a");
    CHECK(merge_results({"{}"}, {"a"}).error().find("a: found no results of this version") == 0);
}

}  // namespace
}  // namespace urgengo::cli
