// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/measure/tracking_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>

#include "tools/bench/smoke/bench_plan.h"
#include "tools/bench/smoke/bench_table.h"
#include "tools/urgengo/text_table.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

/// What the default may cost of the GPU's time, percent, on kernels from this long.
/// @source the project's goal
constexpr double kGoalPct = 0.5;
constexpr double kGoalFromUs = 30;
constexpr char kGoalRow[] = "urgengo";

/// From here on the launching thread is what a frame waits for.
constexpr double kBusy = 0.9;

constexpr char kFooter[] =
    "GPU +%: the time between two events around a frame of a chain, compared with the frame of\n"
    "a bystander's thread next to it, in the same process: median of all pairs. less bare: that, "
    "less\n"
    "what the bare row has, where neither is anything: the cost, which the goal is about. elapsed "
    "+%: the same for the time until the wait for "
    "the\n"
    "frame is over. of bare: the chain's GPU time to that of the bare process.\n"
    "bound: GPU; CPU, where the thread spends 90 % of the frame's GPU time in its launches; "
    "waits,\n"
    "where it spends that in waits of UrgenGo's. CPU ns, a launch: of the launching thread, "
    "without\n"
    "the wait for the frame; + ns: more than the bystander's; others: of all other threads, with\n"
    "that wait. marks: a launch. alone: no other chain has work on the GPU; beside: one has, all "
    "the\n"
    "time, a kernel behind a closed gate, which takes nothing of the GPU.\n";

const char* bound(const TrackingBench& bench, std::size_t row, std::size_t cell) {
    std::vector<double> shares;
    for (const auto& round : bench.runs[row])
        shares.push_back(round[cell].launching_share(bench.cells[cell].frame_launches));
    if (spread(std::move(shares)).median < kBusy) return "GPU";
    return bench.over_rounds(row, cell, &TrackingCellRun::synchronisations).median > 0 ? "waits"
                                                                                       : "CPU";
}

std::optional<std::size_t> bare_row(const TrackingBench& bench) {
    const auto& rows = bench.options.rows;
    const auto bare = std::find(rows.begin(), rows.end(), kBareRow);
    if (bare == rows.end()) return std::nullopt;
    return static_cast<std::size_t>(bare - rows.begin());
}

/// @returns the GPU time of a frame to the bare process'
std::string of_bare(const TrackingBench& bench, std::size_t row, std::size_t cell) {
    const auto bare = bare_row(bench);
    if (!bare) return "";
    return fmt::format("{:.4f}",
                       bench.over_rounds(row, cell, &TrackingCellRun::gpu_us).median /
                           bench.over_rounds(*bare, cell, &TrackingCellRun::gpu_us).median);
}

/// @returns what a chain's frame takes more than the bystander's, less the same of the bare row,
/// percent:
///          two threads of a bare process are not quite alike either
std::optional<double> less_bare(const TrackingBench& bench, std::size_t row, std::size_t cell) {
    const auto bare = bare_row(bench);
    if (!bare || *bare == row) return std::nullopt;
    const auto extra = [&](std::size_t r) {
        return bench.over_rounds(r, cell, &TrackingCellRun::extra_gpu_pct).median;
    };
    return extra(row) - extra(*bare);
}

std::string goal(const TrackingBench& bench, std::size_t row, std::size_t cell) {
    if (bench.options.rows[row] != kGoalRow || bench.cells[cell].kernel_us < kGoalFromUs) return "";
    const auto extra = less_bare(bench, row, cell);
    return !extra ? "" : *extra <= kGoalPct ? "met" : "NOT MET";
}

Json numbers(const TrackingCellRun& run) {
    return {{"pairs", run.pairs},
            {"gpu_us", run.gpu_us},
            {"nobody_gpu_us", run.nobody_gpu_us},
            {"extra_gpu_pct", run.extra_gpu_pct},
            {"extra_elapsed_pct", run.extra_elapsed_pct},
            {"launch_cpu_ns", run.launch_cpu_ns},
            {"nobody_launch_cpu_ns", run.nobody_launch_cpu_ns},
            {"cpu_ns", run.cpu_ns},
            {"nobody_cpu_ns", run.nobody_cpu_ns},
            {"others_cpu_ns", run.others_cpu_ns},
            {"marks", run.marks},
            {"synchronisations", run.synchronisations}};
}

}  // namespace

std::string format_tracking_table(const TrackingBench& bench) {
    TextTable table;
    table.add_row({"row", "kernel us", "", "GPU +%", "less bare", "", "elapsed +%", "of bare",
                   "bound", "CPU ns", "+ ns", "others", "marks"});
    for (std::size_t c = 0; c < bench.cells.size(); ++c)
        for (std::size_t r = 0; r < bench.options.rows.size(); ++r) {
            const auto over_rounds = [&](double TrackingCellRun::*value) {
                return bench.over_rounds(r, c, value);
            };
            std::vector<double> more;
            for (const auto& round : bench.runs[r])
                more.push_back(round[c].launch_cpu_ns - round[c].nobody_launch_cpu_ns);
            const auto less = less_bare(bench, r, c);
            table.add_row(
                {bench.options.rows[r], fmt::format("{}", bench.cells[c].kernel_us),
                 bench.cells[c].situation,
                 format_spread(over_rounds(&TrackingCellRun::extra_gpu_pct), 2),
                 less ? fmt::format("{:+.2f}", *less) : "", goal(bench, r, c),
                 format_spread(over_rounds(&TrackingCellRun::extra_elapsed_pct), 2),
                 of_bare(bench, r, c), bound(bench, r, c),
                 fmt::format("{:.0f}", over_rounds(&TrackingCellRun::launch_cpu_ns).median),
                 format_spread(spread(std::move(more)), 0),
                 fmt::format("{:.0f}", over_rounds(&TrackingCellRun::others_cpu_ns).median),
                 fmt::format("{:.3f}", over_rounds(&TrackingCellRun::marks).median)});
        }
    return table.text() + "\n" + kFooter;
}

std::string to_json(const TrackingBench& bench) {
    Json rows = Json::array();
    for (std::size_t r = 0; r < bench.options.rows.size(); ++r)
        for (std::size_t c = 0; c < bench.cells.size(); ++c) {
            Json runs = Json::array();
            for (const auto& round : bench.runs[r]) runs.push_back(numbers(round[c]));
            rows.push_back({{"row", bench.options.rows[r]},
                            {"kernel_us", bench.cells[c].kernel_us},
                            {"situation", bench.cells[c].situation},
                            {"frame_launches", bench.cells[c].frame_launches},
                            {"bound", bound(bench, r, c)},
                            {"runs", std::move(runs)}});
        }
    const Json json = {{"format_version", 1},
                       {"program", "urgengo bench tracking"},
                       {"gpu", bench.gpu},
                       {"cuda", bench.cuda},
                       {"driver", bench.driver},
                       {"version", bench.version},
                       {"commit", bench.commit},
                       {"date_utc", bench.date_utc},
                       {"command_line", bench.command_line},
                       {"seconds", bench.options.seconds},
                       {"chains", bench.options.chains},
                       {"iterations", bench.iterations},
                       {"rows", std::move(rows)}};
    return json.dump(1) + "\n";
}

}  // namespace urgengo::cli
