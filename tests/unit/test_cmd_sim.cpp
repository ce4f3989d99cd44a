// SPDX-License-Identifier: Apache-2.0
//
// urgengo sim: what it writes is read as `bench smoke`'s, and what it refuses.
#include <nlohmann/json.hpp>

#include "host/config/file_text.h"
#include "tests/support/catch.h"
#include "tests/support/folder.h"
#include "tools/bench/smoke/bench_results.h"
#include "tools/urgengo/cmd_sim.h"
#include "tools/urgengo/exit_codes.h"

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

TEST_CASE("urgengo sim refuses what it cannot run", "[unit][sim]") {
    SimOptions options = short_options();
    SECTION("a row that it does not know") {
        options.rows = {"bare", "fast"};
    }
    SECTION("the same twice") {
        options.seeds = {4, 4};
    }
    SECTION("a workload that is none") {
        options.workload = __FILE__;
    }
    SECTION("a place where it may not write") {
        options.out = "/nonexistent/sim.json";
    }
    CHECK(cmd_sim(options, {"sim"}) == kExitUsage);
}
