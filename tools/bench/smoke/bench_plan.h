// SPDX-License-Identifier: Apache-2.0
//
// What `urgengo bench smoke` and `urgengo bench instances` will run: their options, and the command
// line of every run. Pure.
//
// Every row runs the same program on the same arrivals (same seed). Rows take turns within a
// repeat, so that a drift of clocks or of temperature falls on all of them. A profile is learned
// once, at a low load, on arrivals that no row sees.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tools/urgengo/environment.h"

namespace urgengo::cli {

inline constexpr char kBareRow[] = "bare";  ///< the program alone; rows but these two are presets
/// The same, one chain at a time (bench_floor.h).
inline constexpr char kFloorRow[] = "floor";
inline constexpr char kNoHintsSuffix[] = "-nohints";
/// Factor on arrival rates while a profile is learned.
inline constexpr double kProfileLoad = 0.6;

struct BenchOptions {
    std::vector<double> f_a{0.7, 0.9, 1.1};
    double f_d = 1;
    double seconds = 12;
    int repeats = 1;
    std::uint32_t seed = 1;
    std::vector<std::string> rows{kBareRow, "vanilla", "urgengo"};
    std::string workload;  ///< empty: calibrate
    std::string out;
    std::string keep;                ///< a folder for the runs' files; empty: they go
    std::vector<std::string> merge;  ///< results to merge instead of running anything
    std::string html;
    std::string simgpu = "auto";  ///< auto | yes | no
    std::optional<double> umin, umax;
    std::string threads, cpu, sync, queue;  ///< handed on to urgengo-chains; empty: its defaults
    unsigned frees = 0;                     ///< tasks that free memory in every frame
    bool variable = false;                  ///< inputs vary in size from frame to frame
    std::string profile, profile_nohints;   ///< for rows with and without hints; empty: learn
    bool profile_isolated = false;
    std::optional<double> profile_seconds;
    std::optional<unsigned> eval_interval_us;  ///< of rows that wait for batches and name none
    std::string interposer;                    ///< for `urgengo run`; empty: the one beside us
    bool truth = false;  ///< runs leave behind what `bench instances` compares
};

/// @returns what is wrong with the options; empty if nothing is
std::string check(const BenchOptions& options);

/// What a row's name says.
struct Row {
    std::string preset;  ///< empty: bare
    bool hints = true;
    std::string variant{};  ///< for parse_variant(): "event+learn" of urgengo+event+learn
};
Row parse_row(const std::string& name);
/// @param floor_too  whether kFloorRow is a row
/// @returns what is wrong with the name of a row of `--rows`; empty if nothing is
std::string check_row(const std::string& name, bool floor_too = false);
/// @param row  checked
/// @returns whether it waits for batches and leaves their length to --eval-interval-us
bool takes_interval(const Row& row);

/// @param longest_period  of any chain, at f_a 1
/// @returns seconds after which the chain has had five frames that a profile can be learned from;
///          two more are for the first one's phase and for the start-up
double default_profile_seconds(std::chrono::nanoseconds longest_period);

/// Where things are.
struct BenchPaths {
    std::string urgengo;
    std::string chains;
    std::string yaml, yaml_nohints;  ///< for f_a 1, with and without hints
    std::string workload;
    std::string folder;        ///< for everything written
    std::string real_libcuda;  ///< for `urgengo`; empty: it searches
};

using Arguments = std::vector<std::string>;

/// A copy of a YAML for another load.
struct PlannedYaml {
    std::string source;
    double f_a = 0;
    std::string path;
    double f_d = 1;
    /// Keys to set under `scheduler:` and `cpu:`, as YAML maps; empty: none.
    std::string scheduler{}, cpu{};
};

struct PlannedProfile {
    bool hints = true;
    std::string way;  ///< given | in-situ | isolated
    double seconds = 0;
    std::string path;
    Arguments arguments;  ///< empty: given
};

/// A profile made wrong on purpose (bench_noise.h).
struct PlannedNoise {
    std::string source;
    std::string path;
    unsigned pct = 0;
    std::uint32_t seed = 0;
};

struct PlannedRun {
    std::string row;
    double f_a = 0;
    int repeat = 0;
    std::uint32_t seed = 0;
    Arguments arguments;
    std::string json;               ///< the program's report
    std::string stats;              ///< the scheduler's; empty for the bare row
    std::string yaml;               ///< empty for the bare row
    std::string trace;              ///< empty: none wanted
    bool each_chain_alone = false;  ///< the arguments lack `--only`, once for each of them
};

struct BenchPlan {
    std::string workload;
    Arguments calibrate;  ///< empty: the workload is there already
    std::vector<PlannedYaml> yamls;
    std::vector<PlannedProfile> profiles;
    std::vector<PlannedNoise> noises;
    std::vector<PlannedRun> runs;
    Environment scheduled;  ///< what `urgengo` gets on top of the bench's environment
};

/// @param profile_seconds  unless the options say so
BenchPlan make_plan(const BenchOptions& options, const BenchPaths& paths, double profile_seconds);

}  // namespace urgengo::cli
