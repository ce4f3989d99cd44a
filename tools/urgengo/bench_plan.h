// SPDX-License-Identifier: Apache-2.0
//
// What `urgengo bench smoke` will run: its options, and the command line of every run. Pure.
//
// Every row runs the same program on the same arrivals (same seed). Rows take turns within a
// repeat, so that a drift of clocks or of temperature falls on all of them.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace urgengo::cli {

inline constexpr char kBareRow[] = "bare";  ///< the program alone; all other rows are presets

struct BenchOptions {
    std::vector<double> f_a{0.7, 0.9, 1.1};
    double seconds = 12;
    int repeats = 1;
    std::uint32_t seed = 1;
    std::vector<std::string> rows{kBareRow, "vanilla", "urgengo"};
    std::string workload;  ///< empty: calibrate
    std::string out;
    std::string html;
    std::string simgpu = "auto";  ///< auto | yes | no
    std::optional<double> umin, umax;
    std::string threads, cpu, sync, queue;  ///< handed on to urgengo-chains; empty: its defaults
};

/// @returns what is wrong with the options; empty if nothing is
std::string check(const BenchOptions& options);

/// Where things are.
struct BenchPaths {
    std::string urgengo;
    std::string chains;
    std::string workload;
    std::string folder;        ///< for everything written
    std::string real_libcuda;  ///< handed to `urgengo run`; empty: it searches
};

using Arguments = std::vector<std::string>;

/// One level of load: the files that describe it, and the command that writes them.
struct PlannedLevel {
    double f_a = 0;
    std::string yaml;
    std::string profile;
    Arguments write_config;
};

struct PlannedRun {
    std::string row;
    double f_a = 0;
    int repeat = 0;
    std::uint32_t seed = 0;
    Arguments arguments;
    std::string json;   ///< the program's report
    std::string stats;  ///< the scheduler's; empty for the bare row
};

struct BenchPlan {
    Arguments calibrate;  ///< empty: the workload is there already
    std::vector<PlannedLevel> levels;
    std::vector<PlannedRun> runs;
};

BenchPlan make_plan(const BenchOptions& options, const BenchPaths& paths);

}  // namespace urgengo::cli
