// SPDX-License-Identifier: Apache-2.0
//
// urgengo sim: what it writes is read as `bench smoke`'s, and what it refuses.
#include <algorithm>
#include <nlohmann/json.hpp>

#include "host/config/file_text.h"
#include "tests/support/catch.h"
#include "tests/support/folder.h"
#include "tools/bench/smoke/bench_results.h"
#include "tools/urgengo/cmd_sim.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/sim_compare.h"
#include "tools/urgengo/sim_gates.h"
#include "tools/urgengo/sim_rows.h"
#include "tools/urgengo/sim_workload.h"

using namespace urgengo;
using namespace urgengo::cli;

namespace {

SimOptions short_options() {
    SimOptions options;
    options.seconds = 2;
    options.f_a = {0.9, 1.3};
    options.seeds = {4, 5};
    options.rows = {"bare", "vanilla"};
    options.quiet = true;
    return options;
}

}  // namespace

TEST_CASE("urgengo sim writes every run as bench smoke does", "[unit][sim]") {
    const testing::Folder folder;
    SimOptions options = short_options();
    options.out = folder.path("sim.json");
    REQUIRE(cmd_sim(options, {"sim"}) == 0);
    const auto text = config::read_file(options.out);
    REQUIRE(text);
    const auto root = nlohmann::json::parse(*text);
    CHECK(root.at("program") == "urgengo sim");
    CHECK(root.at("simulated") == "virtual");
    CHECK(root.at("effects").at("rows").size() == 4);
    REQUIRE(root.at("runs").size() == 8);
    for (const auto& run : root.at("runs")) {
        CHECK(run.at("blocks_of_chains").size() == 10);
        const auto report = parse_report(run.at("report").dump(), "report");
        REQUIRE(report);
        CHECK(report->chains.size() == 10);
        CHECK(report->miss_pct == Approx(run.at("overall_miss_pct").get<double>()));
    }
}

TEST_CASE("urgengo sim tells how many gates rows closed that close some", "[unit][sim]") {
    const testing::Folder folder;
    SimOptions options = short_options();
    options.f_a = {0.9};
    options.seeds = {4};
    options.rows = {"bare", "urgengo+dispatch=armed", "urgengo+dispatch=host@400"};
    options.out = folder.path("sim.json");
    REQUIRE(cmd_sim(options, {"sim"}) == 0);
    const auto root = nlohmann::json::parse(*config::read_file(options.out));
    REQUIRE(root.at("runs").size() == 3);
    for (const auto& run : root.at("runs")) {
        const std::string row = run.at("row");
        INFO(row);
        CHECK(run.contains("gates") == (row != "bare"));
        if (!run.contains("gates")) continue;
        CHECK(run.at("gates").at("closed") > 1000);
        CHECK((run.at("gates").at("opened_by_gpu") > 0) == (row == "urgengo+dispatch=armed"));
    }
}

TEST_CASE("urgengo sim tells for how long gates were open for calls that wait for all GPU work",
          "[unit][sim]") {
    const testing::Folder folder;
    SimOptions options = short_options();
    options.f_a = {0.9};
    options.seeds = {4};
    options.rows = {"bare", "urgengo+dispatch=host"};
    options.parking_every_ms = GENERATE(0, 40);
    options.out = folder.path("sim.json");
    REQUIRE(cmd_sim(options, {"sim"}) == 0);
    const auto root = nlohmann::json::parse(*config::read_file(options.out));
    const auto& gates = root.at("runs")[1].at("gates");
    const double parks = gates.at("parks");
    CHECK((parks > 0) == (options.parking_every_ms > 0));
    CHECK(parks <= 1000 * options.seconds / 40);
    CHECK((gates.at("parked_ms") > 0) == (parks > 0));
    CHECK(gates.at("longest_park_ms") <= gates.at("parked_ms"));
    std::vector<SimRun> runs(1);
    runs[0].gates.emplace();
    CHECK(format_gates(runs, 1).find("parks") == std::string::npos);
    runs[0].gates->parks = 3;
    CHECK(format_gates(runs, 1).find("parks") != std::string::npos);
}

TEST_CASE("urgengo sim refuses what it cannot run", "[unit][sim]") {
    SimOptions options = short_options();
    SECTION("a row that it does not know") {
        options.rows = {"bare", "fast"};
    }
    SECTION("a row that is not modelled") {
        options.rows = {"urgengo-nohints"};
    }
    SECTION("a change of a row that is not modelled") {
        options.rows = {"urgengo+async"};
    }
    SECTION("a file to compare with that is none") {
        options.compare = __FILE__;
    }
    SECTION("the same twice") {
        options.seeds = {4, 4};
    }
    SECTION("a workload that is none") {
        options.workload = __FILE__;
    }
    SECTION("a profile of no chains.yaml") {
        options.profile = URGENGO_SIM_DATA "/h100_mix_a.profile.json";
    }
    SECTION("a chains.yaml without a profile") {
        options.workload = URGENGO_CHAINS_FOLDER "/chains.yaml";
    }
    SECTION("a place where it may not write") {
        options.out = "/nonexistent/sim.json";
    }
    CHECK(cmd_sim(options, {"sim"}) == kExitUsage);
}

TEST_CASE("urgengo sim runs what a results file has, and says by how much it differs",
          "[unit][sim]") {
    const testing::Folder folder;
    SimOptions options = short_options();
    options.rows = {"edf", "bare"};
    options.out = folder.path("sim.json");
    REQUIRE(cmd_sim(options, {"sim"}) == 0);
    const auto measured = read_measured(options.out);
    REQUIRE(measured);
    CHECK(measured->rows() == options.rows);
    CHECK(measured->levels() == options.f_a);
    CHECK(measured->seeds() == options.seeds);

    SimOptions same;
    same.compare = options.out;
    same.quiet = true;
    same.out = folder.path("again.json");
    REQUIRE(cmd_sim(same, {"sim"}) == 0);
    const auto again = read_measured(same.out);
    REQUIRE(again);
    REQUIRE(again->runs.size() == measured->runs.size());
    for (std::size_t i = 0; i < again->runs.size(); ++i)
        CHECK(again->runs[i].miss_pct == measured->runs[i].miss_pct);
}

TEST_CASE("Simulated misses are compared by row, load and seed", "[unit][sim]") {
    const auto run = [](const char* row, double f_a, std::uint32_t seed, double miss_pct) {
        RunResult result;
        result.row = row;
        result.f_a = f_a;
        result.seed = seed;
        result.miss_pct = miss_pct;
        return result;
    };
    BenchResults simulated;
    simulated.rows = {"urgengo+guard=off", "paam", "bare"};
    simulated.levels = {0.9, 1.1};
    simulated.runs = {run("urgengo+guard=off", 0.9, 4, 1), run("urgengo+guard=off", 0.9, 5, 3),
                      run("paam", 0.9, 4, 30), run("bare", 0.9, 4, 20), run("bare", 1.1, 4, 40)};
    Measured measured;
    measured.runs = {{"urgengo", 0.9, 4, 2}, {"urgengo", 0.9, 5, 0}, {"urgengo", 0.9, 6, 90},
                     {"paam", 0.9, 4, 15},   {"bare", 0.9, 4, 20},   {"paper", 0.9, 4, 15}};
    const SimComparison comparison = compare(simulated, measured);
    REQUIRE(comparison.cells.size() == 3);
    CHECK(comparison.cells[0].seeds == 2);
    CHECK(comparison.cells[0].difference() == Approx(1));
    CHECK(comparison.cells[1].difference() == Approx(15));
    CHECK(comparison.mean_absolute_difference == Approx(16.0 / 3));
    CHECK(comparison.pairs == 3);
    CHECK(comparison.alike == 2);  // paam and bare have changed places
}

namespace {

/// Results of the mix in tools/sim/data as tools/bench/network_mixes.py writes them.
std::string write_mixes(const testing::Folder& folder) {
    const auto run = [](const char* row, bool bystander, double miss_pct) {
        nlohmann::json its = {{"mix", "A"},
                              {"load", 0.9},
                              {"row", row},
                              {"seed", 6},
                              {"bystander", bystander},
                              {"overall_miss_pct", miss_pct},
                              {"networks", nlohmann::json::array()},
                              {"scheduler_stats", nullptr}};
        nlohmann::json chains = nlohmann::json::array();
        for (const char* name : {"n0_segformer", "n1_distilbert", "n2_ghostnet", "n3_vgg16",
                                 "n4_fcn", "n5_wide_resnet5", "n6_mixer"}) {
            its["networks"].push_back({{"name", name}, {"period_ms", 20}, {"deadline_ms", 15}});
            chains.push_back({{"name", name}, {"launch_pace", 1.5}});
        }
        if (row != std::string("bare")) its["scheduler_stats"] = {{"chains", chains}};
        return its;
    };
    const nlohmann::json root = {
        {"program", "tools/bench/network_mixes.py"},
        {"gpu", "a GPU"},
        {"commit", "abc"},
        {"date_utc", "today"},
        {"options", {{"seconds", 1.5}, {"warmup", 0.5}, {"priorities", "admission: none"}}},
        {"runs",
         {run("bare", false, 1), run("bare", true, 80), run("priorities", true, 2),
          run("alone", true, 0)}}};
    return folder.write("mixes.json", root.dump());
}

const std::string kMix = URGENGO_SIM_DATA "/h100_mix_a.yaml";

}  // namespace

TEST_CASE("A mix of networks is compared with its runs beside the bystander, or those without",
          "[unit][sim]") {
    const testing::Folder folder;
    SimOptions options;
    options.workload = kMix;
    options.compare = write_mixes(folder);
    options.quiet = true;
    options.out = folder.path("sim.json");
    const auto run_it = [&] {
        REQUIRE(cmd_sim(options, {"sim"}) == 0);
        const auto simulated = read_measured(options.out);
        REQUIRE(simulated);
        return *simulated;
    };
    SECTION("without") {
        const Measured simulated = run_it();
        CHECK(simulated.rows() == std::vector<std::string>{"bare"});
        CHECK(simulated.seconds == 2);
        CHECK(simulated.runs[0].miss_pct == 0);
    }
    SECTION("beside it") {
        options.bystander_matmul = true;
        const Measured simulated = run_it();
        REQUIRE(simulated.runs.size() == 2);
        const auto misses = [&](const char* row) {
            return std::find_if(simulated.runs.begin(), simulated.runs.end(),
                                [&](const auto& one) { return std::string(row) == one.row; })
                ->miss_pct;
        };
        // 20 ms for 303 launches, each behind a matrix product of 0.2 ms; but not the urgent ones.
        CHECK(misses("bare") > 50);
        CHECK(misses("urgengo+admission=none") < 10);
    }
    SECTION("and with no other workload") {
        options.workload.clear();
        CHECK(cmd_sim(options, {"sim"}) == kExitUsage);
    }
}

TEST_CASE("A profile in columns is the one that it was made from", "[unit][sim]") {
    const std::string whole =
        R"({"chains":[{"name":"a","tasks":[{"kernels":[{"gpu_time_ns":5,"name":"k"},)"
        R"({"gpu_time_ns":6,"name":"l"}],"name":"t"}]}]})";
    const std::string columns = R"({"chains":[{"name":"a","tasks":[{"name":"t","kernels":)"
                                R"({"name":["k","l"],"gpu_time_ns":[5,6]}}]}]})";
    CHECK(without_columns(columns) == whole);
    CHECK(without_columns(whole) == whole);
    CHECK(without_columns("no JSON") == "no JSON");
}

TEST_CASE("All rows of urgengo sim are bare and every preset", "[unit][sim]") {
    const auto rows = expand_rows({"all"});
    CHECK(rows.front() == "bare");
    CHECK(rows.size() > 10);
    for (const std::string& row : rows) CHECK(check_sim_row(row).empty());
    CHECK(check_sim_row("urgengo+guard=off+noise=30").empty());
    CHECK(check_sim_row("urgengo+dispatch=thread").empty());
    for (const char* way : {"host", "leased", "armed@400", "piggyback", "device", "auto"})
        CHECK(check_sim_row(std::string("urgengo+dispatch=") + way).empty());
    CHECK(check_sim_row("urgengo+nice=-15") ==
          "--rows: found 'urgengo+nice=-15', not simulated: priorities of the host's cores");
}
