// SPDX-License-Identifier: Apache-2.0
//
// urgengo bench tracking: what it runs, how it reads a run, and what it says of it; and the rows'
// names that it shares with the other benches.
#include "tools/bench/measure/tracking_bench.h"

#include <nlohmann/json.hpp>

#include "tests/support/catch.h"
#include "tools/bench/measure/tracking_table.h"

namespace urgengo::cli {
namespace {

using namespace std::chrono_literals;
using Json = nlohmann::ordered_json;

BenchTrackingOptions two_kernels() {
    BenchTrackingOptions options;
    options.kernel_us = {3, 30};
    options.rows = {"bare", "urgengo"};
    options.chains = 2;
    return options;
}

TEST_CASE("Tracking bench has a chain for every kernel and situation", "[unit][cli]") {
    const BenchTrackingOptions options = two_kernels();
    const auto cells = plan_cells(options);
    REQUIRE(cells.size() == 4);
    CHECK(cells[1].situation == "alone");
    CHECK(cells[1].kernel_us == 30);
    CHECK(cells[1].frame_launches == 500);
    CHECK(cells[2].situation == "beside");
    CHECK(cells[2].frame_launches == 800);  // the driver's queue takes no more

    const auto spec = plan_config(options, "edf+event+every=20");
    REQUIRE(spec.measured.size() == 4);
    CHECK(spec.measured[2].name == "ug_cell_2");
    CHECK(spec.measured[2].thread == "ug_cell_2");
    CHECK(spec.measured[2].kernel_us == 3);
    CHECK(spec.measured[2].frame_launches == 800);
    CHECK(spec.num_others == 3);  // the bystander, and the idle ones
    CHECK(spec.scheduler.preset == "edf");
    CHECK(spec.scheduler.progress.source == config::ProgressSource::kEvent);
    CHECK(spec.scheduler.progress.mark_every == 20us);
}

TEST_CASE("Tracking bench gives its interval to ways of tracking", "[unit][cli]") {
    BenchTrackingOptions options = two_kernels();
    options.eval_interval_us = 250;
    const auto scheduler = plan_config(options, "urgengo+overlapped").scheduler;
    CHECK(scheduler.progress.tracking == config::Tracking::kOverlapped);
    CHECK(scheduler.progress.eval_interval == 250us);
    CHECK(plan_config(options, "urgengo").scheduler.progress.tracking ==
          config::Tracking::kProgress);
    CHECK(plan_config(options, "urgengo").scheduler.progress.eval_interval == 500us);
}

TEST_CASE("Tracking bench refuses rows and numbers that make no sense", "[unit][cli]") {
    BenchTrackingOptions options;
    CHECK(check(options).empty());
    options.rows = {"bare", "urgengo-nohints"};
    CHECK(check(options) == "--rows: found 'urgengo-nohints', accepted: rows without -nohints");
    options.rows = {"urgengo", "urgengo"};
    CHECK(check(options) == "--rows: found 'urgengo' twice, accepted: once");
    options.rows = {"urgengo+often"};
    CHECK(check(options).find("--rows: found 'urgengo+often', accepted after each '+': ") == 0);
    options.rows = {"urgengo"};
    options.iterations = {1};
    CHECK(check(options) == "--iterations: found 1, accepted: one for each of 4 --kernel-us");
    options.iterations.clear();
    options.chains = 252;
    CHECK(check(options) ==
          "--kernel-us: found 8 kernels and situations, accepted: 3 beside 252 idle --chains");
}

Json frames(std::vector<double> gpu_us, double launch_cpu_us) {
    const std::vector<double> launch_cpu(gpu_us.size(), launch_cpu_us),
        thread_cpu(gpu_us.size(), launch_cpu_us * 2), process_cpu(gpu_us.size(), launch_cpu_us * 5);
    return {{"gpu_us", gpu_us},
            {"elapsed_us", gpu_us},
            {"launch_cpu_us", launch_cpu},
            {"thread_cpu_us", thread_cpu},
            {"process_cpu_us", process_cpu}};
}

std::string program_json(double chain_us, double launch_cpu_us) {
    // The clock drifts: only neighbours may be compared.
    const Json cell = {{"chain", frames({chain_us, chain_us * 1.5, chain_us * 2}, launch_cpu_us)},
                       {"nobody", frames({1000, 1500, 2000}, 100)}};
    return Json{{"cells", {cell}}}.dump();
}

std::string statistics(int launches, int scheduled) {
    const Json chain = {{"name", "ug_cell_0"}, {"launches", launches}, {"scheduled", scheduled},
                        {"holds", 0},          {"marks", 50},          {"synchronisations", 0}};
    return Json{{"chains", {chain}}}.dump();
}

const std::vector<TrackingCellPlan> kOneCell{{"alone", 30, 100}};

TEST_CASE("Tracking bench compares a frame with its neighbour", "[unit][cli]") {
    const auto run = parse_tracking_run(program_json(1010, 400), statistics(200, 200), kOneCell);
    INFO((run ? "" : run.error()));
    REQUIRE(run);
    const TrackingCellRun& cell = run->at(0);
    CHECK(cell.pairs == 3);
    CHECK(cell.gpu_us == 1515);
    CHECK(cell.extra_gpu_pct == Approx(1));
    CHECK(cell.extra_elapsed_pct == Approx(1));
    CHECK(cell.launch_cpu_ns == 4000);
    CHECK(cell.nobody_launch_cpu_ns == 1000);
    CHECK(cell.cpu_ns == 8000);
    CHECK(cell.others_cpu_ns == 12000);
    CHECK(cell.marks == 0.25);
    CHECK(cell.launching_share(100) == Approx(400.0 / 1515));
}

TEST_CASE("Tracking bench does not take a run for what it is not", "[unit][cli]") {
    const auto error = [](const std::string& json, const std::string& stats) {
        const auto run = parse_tracking_run(json, stats, kOneCell);
        return run ? "" : run.error();
    };
    CHECK(error(program_json(1010, 400), statistics(200, 150)) ==
          "ug_cell_0: 150 of 200 launches were scheduled");
    CHECK(error(program_json(1010, 400), "").empty());  // a bare run has none
    CHECK_FALSE(error("{}", "").empty());
    CHECK_FALSE(error("", "").empty());
}

TrackingBench two_rows(double extra, double launch_cpu_us) {
    TrackingBench bench;
    bench.options = two_kernels();
    bench.cells = kOneCell;
    bench.runs = {{*parse_tracking_run(program_json(1000, 100), "", kOneCell)},
                  {*parse_tracking_run(program_json(1000 * (1 + extra), launch_cpu_us),
                                       statistics(200, 200), kOneCell)}};
    return bench;
}

TEST_CASE("Tracking table says what is above the goal, and what a frame waits for", "[unit][cli]") {
    const auto line_of = [](const std::string& table, const char* row) {
        const auto begin = table.find(row) + 1;
        return table.substr(begin, table.find('\n', begin) - begin);
    };
    const std::string table = format_tracking_table(two_rows(0.004, 200));
    CHECK(table.find("GPU +%  less bare ") != std::string::npos);
    CHECK(line_of(table, "\nbare ").find(" 0.00 ") != std::string::npos);
    const std::string line = line_of(table, "\nurgengo ");
    INFO(line);
    for (const char* part : {" 30 ", " alone ", " 0.40 ", " +0.40 ", " met ", " 1.0040 ", " GPU ",
                             " 2000 ", " 1000 ", " 6000 ", " 0.250"})
        CHECK(line.find(part) != std::string::npos);
    CHECK(format_tracking_table(two_rows(0.006, 200)).find("NOT MET") != std::string::npos);
    // Where the two threads of a bare process differ, too, that is not the cost.
    TrackingBench both = two_rows(0.006, 200);
    both.runs[0][0][0].extra_gpu_pct = 0.2;
    CHECK(format_tracking_table(both).find("NOT MET") == std::string::npos);
    both.runs[0][0][0].extra_gpu_pct = -5;
    both.runs[1][0][0].extra_gpu_pct = -4;
    CHECK(format_tracking_table(both).find("NOT MET") != std::string::npos);
    both.options.rows = {"vanilla", "urgengo"};  // nothing to compare with
    CHECK(format_tracking_table(both).find("met") == std::string::npos);
    TrackingBench busy = two_rows(0, 1400);
    CHECK(format_tracking_table(busy).find(" CPU  ") != std::string::npos);
    busy.runs[1][0][0].synchronisations = 1;
    CHECK(format_tracking_table(busy).find(" waits  ") != std::string::npos);
}

TEST_CASE("Tracking bench keeps every run in its JSON", "[unit][cli]") {
    const Json json = Json::parse(to_json(two_rows(0.01, 200)));
    REQUIRE(json.at("rows").size() == 2);
    CHECK(json["rows"][1]["row"] == "urgengo");
    CHECK(json["rows"][1]["situation"] == "alone");
    CHECK(json["rows"][1]["runs"][0]["extra_gpu_pct"].get<double>() == Approx(1));
    CHECK(json["rows"][1]["runs"][0]["marks"] == 0.25);
    for (const char* condition : {"gpu", "driver", "cuda", "commit", "date_utc", "command_line"})
        CHECK(json.contains(condition));
}

}  // namespace
}  // namespace urgengo::cli
