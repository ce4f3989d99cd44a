// SPDX-License-Identifier: Apache-2.0
//
// `urgengo sim --compare`: simulated misses beside those that a GPU has had, of the same rows,
// loads and seeds. Results are those of `urgengo bench smoke`, or of mixes of real networks
// (sim_mixes.h).
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "tools/bench/smoke/bench_results.h"
#include "tools/sim/recorded.h"

namespace urgengo::cli {

/// What a results file of `bench smoke`, or of `urgengo sim`, says of each run.
struct MeasuredRun {
    std::string row;
    double f_a = 0;
    std::uint32_t seed = 0;
    double miss_pct = 0;
};

struct Measured {
    std::string gpu, commit, date_utc;
    double seconds = 0, f_d = 1;
    double warmup = 0;  ///< of `seconds`: whose frames do not count
    std::vector<MeasuredRun> runs;
    /// Of mixes, where a run's f_a is its load: what periods and deadlines that is.
    std::map<double, std::vector<sim::ChainTimes>> times{};

    /// In the order of the runs, each once; rows without those that cannot be simulated.
    std::vector<std::string> rows() const;
    std::vector<double> levels() const;
    std::vector<std::uint32_t> seeds() const;
};

/// What is simulated, to choose between the runs of a file that has others, too.
struct MeasuredChoice {
    std::vector<std::string> chains{};
    bool beside_bystander = false;
};

/// @errors file, place, what was found and what is accepted
Result<Measured> read_measured(const std::string& path, const MeasuredChoice& choice = {});

/// A row at a load: means over the seeds that both have.
struct ComparedCell {
    std::string row;
    double f_a = 0;
    double simulated_pct = 0, measured_pct = 0;
    int seeds = 0;

    double difference() const { return simulated_pct - measured_pct; }
};

struct SimComparison {
    std::vector<ComparedCell> cells;
    double mean_absolute_difference = 0;
    /// Pairs of rows at one load that the GPU tells apart by more than kTold, and how many of those
    /// are in the same order in the simulation.
    int pairs = 0, alike = 0;

    static constexpr double kTold = 2;  ///< points
};

/// A simulated row without one of its name is compared with its preset's: urgengo+guard=off with
/// urgengo.
SimComparison compare(const BenchResults& simulated, const Measured& measured);

std::string format_comparison(const SimComparison& comparison, const Measured& measured);

}  // namespace urgengo::cli
