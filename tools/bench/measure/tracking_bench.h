// SPDX-License-Identifier: Apache-2.0
//
// What `urgengo bench tracking` runs and finds: what knowing the executing kernel costs, by way of
// tracking, source of progress, kernel and situation. Pure.
//
// A run is one process of one row. In it, cell by cell (a kernel's time, alone or beside another
// chain), frames of a chain and frames of a bystander take turns; a cell's cost is the median of
// their ratios, so that neither a process' luck nor the GPU's clock is in it. Rows take turns
// within a round.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "tools/bench/bench_config.h"
#include "tools/bench/smoke/bench_results.h"

namespace urgengo::cli {

struct BenchTrackingOptions {
    std::vector<double> kernel_us{3, 10, 30, 100};
    std::vector<std::string> rows{"bare",
                                  "urgengo",
                                  "urgengo+memop",
                                  "urgengo+event",
                                  "urgengo+kernel+every=20",
                                  "urgengo+memop+every=20",
                                  "urgengo+event+every=20",
                                  "urgengo+async",
                                  "urgengo+sync",
                                  "urgengo+batched",
                                  "urgengo+overlapped"};
    std::vector<std::string> situations{bench::kAlone, bench::kBeside};
    std::optional<unsigned> eval_interval_us;  ///< of rows with a way of tracking
    int chains = 10;                           ///< idle ones, in the config
    int rounds = 3;
    double seconds = 0.35;             ///< of a cell in a run
    std::vector<unsigned> iterations;  ///< by kernel; empty: found at the start
    std::string out;
};

/// @returns what is wrong with the options; empty if nothing is
std::string check(const BenchTrackingOptions& options);

/// @returns how many launches a frame has: long enough for a half percent to show, and fewer than
///          fill the driver's queue, which would keep the launching thread
int frame_launches(double kernel_us);

struct TrackingCellPlan {
    std::string situation;
    double kernel_us = 0;
    int frame_launches = 0;
};
/// In the order in which the program runs them.
std::vector<TrackingCellPlan> plan_cells(const BenchTrackingOptions& options);

/// The row's config.
/// @param row  not bare; checked
bench::ConfigSpec plan_config(const BenchTrackingOptions& options, const std::string& row);

/// One cell in one run. Of frames it is the median; "extra" compares a chain's frame with the
/// bystander's (`nobody`).
struct TrackingCellRun {
    std::uint64_t pairs = 0;
    double gpu_us = 0, nobody_gpu_us = 0;  ///< of a frame
    double extra_gpu_pct = 0, extra_elapsed_pct = 0;
    double launch_cpu_ns = 0, nobody_launch_cpu_ns = 0;  ///< of the thread, a launch
    double cpu_ns = 0, nobody_cpu_ns = 0;                ///< of the thread, a launch, with the wait
    double others_cpu_ns = 0;                            ///< of other threads, a launch
    double marks = 0, synchronisations = 0;              ///< a launch

    /// The share of the GPU's time in which the launching thread is busy with its launches.
    double launching_share(int frame_launches) const {
        return launch_cpu_ns * frame_launches / (gpu_us * 1e3);
    }
};

/// @param json   what the program wrote
/// @param stats  what UrgenGo wrote at its exit; empty for a bare run
/// @errors what is wrong with either
Result<std::vector<TrackingCellRun>> parse_tracking_run(const std::string& json,
                                                        const std::string& stats,
                                                        const std::vector<TrackingCellPlan>& cells);

struct TrackingBench {
    BenchTrackingOptions options;
    std::vector<TrackingCellPlan> cells;
    std::vector<std::vector<std::vector<TrackingCellRun>>> runs;  ///< shape [rows][rounds][cells]
    std::vector<unsigned> iterations;
    std::string gpu, cuda, driver, version, commit, date_utc, command_line;

    Spread over_rounds(std::size_t row, std::size_t cell, double TrackingCellRun::*value) const;
};

}  // namespace urgengo::cli
