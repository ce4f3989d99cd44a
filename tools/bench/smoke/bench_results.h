// SPDX-License-Identifier: Apache-2.0
//
// What the runs of a bench found, and the numbers that tables and charts show. Pure.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "tools/bench/smoke/bench_profile.h"

namespace urgengo::cli {

/// Frames that arrived within one second of a run: what a bootstrap draws.
struct Block {
    unsigned frames = 0, missed = 0;
};

struct ChainResult {
    std::string name;
    double deadline_ms = 0;
    double miss_pct = 0;
    std::vector<Block> blocks{};  ///< by second since the run's first arrival; empty: not known
};

/// One run of urgengo-chains.
struct RunResult {
    std::string row;
    double f_a = 0;
    int repeat = 0;
    std::uint32_t seed = 0;
    std::string gpu;
    std::string driver;
    std::string urgengo;   ///< what the program saw: "not loaded", "scheduling", ...
    double miss_pct = 0;   ///< overall deadline miss ratio: the mean of the chains' miss ratios
    double exited = 0;     ///< instances given up early, over all chains
    double cpu_cores = 0;  ///< mean, of the whole process
    std::vector<ChainResult> chains;
    std::string report;       ///< the program's JSON, as written
    std::string stats;        ///< the scheduler's JSON, as written; may be empty
    std::string yaml, trace;  ///< as planned; gone when the bench ends

    std::size_t num_blocks() const;
};

/// Fills everything from gpu to chains, and report; blocks if the report lists every instance.
/// @errors what is wrong with the JSON
Result<RunResult> parse_report(const std::string& json, const std::string& file);

struct Spread {
    double median = 0, min = 0, max = 0;
};

/// @param values  not empty
Spread spread(std::vector<double> values);

struct BenchResults {
    bool simulated = false;
    std::string gpu_line;  ///< one line: which GPU, and why this one
    std::string version, commit, date_utc, command_line;
    std::vector<std::pair<std::string, std::string>> parameters;
    std::string workload_hash;  ///< of its file
    std::vector<std::string> rows;
    std::vector<double> levels;  ///< f_a
    std::vector<ProfileSummary> profiles;
    std::vector<RunResult> runs;

    /// The runs' `value`, over the repeats of one row at one level.
    Spread over_repeats(const std::string& row, double f_a,
                        const std::function<double(const RunResult&)>& value) const;
    Spread miss_pct(const std::string& row, double f_a) const;
    Spread chain_miss_pct(const std::string& row, double f_a, std::size_t chain) const;
    /// The chains, as the first run at this level had them.
    const std::vector<ChainResult>& chains(double f_a) const;
};

}  // namespace urgengo::cli
