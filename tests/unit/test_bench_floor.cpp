// SPDX-License-Identifier: Apache-2.0
//
// urgengo bench smoke --rows floor: each chain has the machine for itself, and the runs make one.
#include "tools/bench/smoke/bench_floor.h"

#include <nlohmann/json.hpp>

#include "host/config/file_text.h"
#include "tests/support/catch.h"
#include "tests/support/folder.h"
#include "tools/bench/smoke/bench_plan.h"
#include "tools/bench/smoke/bench_runner.h"
#include "tools/urgengo/program/run_process.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

/// A run of one chain whose frames arrive `ms` after its start. The first `missed` are late.
Json report(const std::string& chain, std::int64_t start_ns, const std::vector<int>& ms,
            std::size_t missed) {
    Json records = Json::array();
    for (std::size_t i = 0; i < ms.size(); ++i)
        records.push_back({{"outcome", i < missed ? "late" : "on_time"},
                           {"arrival_ns", start_ns + ms[i] * 1'000'000LL},
                           {"thread", 5},
                           {"end_ns", start_ns + ms[i] * 1'000'000LL + 7}});
    const double ratio = ms.empty() ? 0 : static_cast<double>(missed) / double(ms.size());
    return {{"version", "1"},
            {"commit", "c"},
            {"parameters", {{"only", chain}, {"seed", "3"}}},
            {"gpu", "G"},
            {"cuda_driver_version", "13.0"},
            {"kernel_driver_version", nullptr},
            {"cpu_segments", "spin"},
            {"urgengo", "not loaded"},
            {"start_ns", start_ns},
            {"wall_s", 2.0},
            {"cpu_cores", 0.25},
            {"overall_miss_ratio", ratio},
            {"throughput", {{"arrivals_s", 2.0}, {"finished", 4}, {"instances_per_s", 2.0}}},
            {"chains",
             {{{"name", chain},
               {"deadline_ms", 42.0},
               {"instances", ms.size()},
               {"missed", missed},
               {"miss_ratio", ratio},
               {"exited", 0},
               {"records", records}}}}};
}

TEST_CASE("Floor is one run of the chains that had the machine for themselves", "[unit][cli]") {
    const auto combined =
        combine_reports({report("C0", 5'000'000'000, {100, 1200, 1300, 1400}, 1).dump(),
                         report("C1", 9'000'000'000, {300, 600}, 2).dump(),
                         report("C2", 1'000'000'000, {}, 0).dump()},
                        {"C0", "C1", "C2"});
    INFO((combined ? "" : combined.error()));
    REQUIRE(combined);
    const auto run = parse_report(*combined, "floor");
    REQUIRE(run);
    CHECK(run->miss_pct == Approx(62.5));  // the chain without a frame does not count
    CHECK(run->cpu_cores == Approx(0.75));
    REQUIRE(run->chains.size() == 3);
    CHECK(run->chains[0].miss_pct == Approx(25));
    CHECK(run->chains[1].miss_pct == Approx(100));
    // As if in one run: seconds count from its first frame, whichever chain's that is.
    REQUIRE(run->chains[0].blocks.size() == 2);
    CHECK(run->chains[0].blocks[0].frames == 1);
    CHECK(run->chains[0].blocks[0].missed == 1);
    CHECK(run->chains[0].blocks[1].frames == 3);
    REQUIRE(run->chains[1].blocks.size() == 1);
    CHECK(run->chains[1].blocks[0].missed == 2);
    const Json json = Json::parse(*combined);
    CHECK(json["parameters"]["only"] == "each chain alone");
    CHECK(json["parameters"]["seed"] == "3");
    CHECK(json["throughput"]["finished"] == 12);
    CHECK(json["throughput"]["instances_per_s"] == 6.0);
    CHECK(json["chains"][1]["records"][0]["arrival_ns"] == 300'000'000);
    CHECK(json["chains"][1]["records"][0]["end_ns"] == 300'000'007);
    CHECK(json["chains"][1]["records"][0]["thread"] == 5);
}

TEST_CASE("Floor refuses runs that are not of one chain alone and alike", "[unit][cli]") {
    const std::string first = report("C0", 0, {1}, 0).dump();
    Json second = report("C1", 0, {1}, 0);
    CHECK(combine_reports({first, second.dump()}, {"C0", "C2"}).error() ==
          "found a report of other chains, accepted: of C2 alone");
    second["chains"].push_back(second["chains"][0]);
    CHECK(combine_reports({first, second.dump()}, {"C0", "C1"}).error() ==
          "found a report of other chains, accepted: of C1 alone");
    second = report("C1", 0, {1}, 0);
    second["urgengo"] = "scheduling";
    CHECK(combine_reports({first, second.dump()}, {"C0", "C1"}).error() ==
          "C1: urgengo: found \"scheduling\", accepted: \"not loaded\", as of the first chain");
    CHECK(combine_reports({"{}"}, {"C0"}).error().find("the report of a chain alone: ") == 0);
}

TEST_CASE("Floor takes the chains from the workload", "[unit][cli]") {
    const auto names = chain_names(R"({"chains":[{"name":"C0"},{"name":"left"}]})", "w.json");
    REQUIRE(names);
    CHECK(*names == std::vector<std::string>{"C0", "left"});
    CHECK(chain_names(R"({"chains":[]})", "w.json").error() ==
          "w.json: $.chains: found an array, accepted: at least one chain");
}

TEST_CASE("Floor runs the bare row's program once for each chain", "[unit][cli]") {
    const testing::Folder folder;
    BenchOptions options;
    options.f_a = {0.9};
    options.rows = {"bare", "floor"};
    BenchPaths paths;
    paths.chains = "/bin/chains";
    paths.folder = "/t";
    paths.workload = "/t/w.json";
    const BenchPlan ten = make_plan(options, paths, 6);
    REQUIRE(ten.runs.size() == 2);
    CHECK(ten.profiles.empty());
    CHECK_FALSE(ten.runs[0].each_chain_alone);
    CHECK(ten.runs[1].each_chain_alone);
    std::string bare = shell_line(ten.runs[0].arguments);
    bare.replace(bare.find("/t/bare_"), 8, "/t/floor_");
    CHECK(shell_line(ten.runs[1].arguments) == bare);

    folder.write("w.json", R"({"chains":[{"name":"C0"},{"name":"C1"}]})");
    folder.write("C0", report("C0", 0, {1}, 0).dump());
    folder.write("C1", report("C1", 0, {1}, 1).dump());
    folder.write("stub", "echo \"$*\" >>\"$HERE/log\"\ncp \"$HERE/$3\" \"$1\"\n");
    BenchPlan plan;
    plan.workload = folder.path("w.json");
    PlannedRun run;
    run.row = "floor";
    run.each_chain_alone = true;
    run.json = folder.path("run.json");
    run.arguments = {"/bin/sh", folder.path("stub"), run.json};
    plan.runs = {run};
    const Environment environment{{"HERE", folder.path("")}, {"PATH", "/usr/bin:/bin"}};
    const auto outcome = carry_out(plan, environment);
    INFO((outcome ? "" : outcome.error()));
    REQUIRE(outcome);
    CHECK(*config::read_file(folder.path("log")) ==
          run.json + " --only C0\n" + run.json + " --only C1\n");
    REQUIRE(outcome->runs.size() == 1);
    CHECK(outcome->runs[0].row == "floor");
    CHECK(outcome->runs[0].miss_pct == Approx(50));
    CHECK(outcome->runs[0].chains.size() == 2);

    folder.write("C1", R"({"chains":[]})");
    const auto wrong = carry_out(plan, environment);
    REQUIRE_FALSE(wrong);
    CHECK(wrong.error().find("run failed: found a report of other chains") == 0);
}

}  // namespace
}  // namespace urgengo::cli
