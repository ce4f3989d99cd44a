// SPDX-License-Identifier: Apache-2.0
//
// What every `urgengo bench` does before and after its runs: options, finding its parts, choosing
// the GPU, and writing what came out.
#pragma once

#include <CLI/CLI.hpp>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "host/base/result.h"
#include "tools/bench/smoke/bench_plan.h"
#include "tools/bench/smoke/bench_runner.h"
#include "tools/urgengo/environment.h"
#include "tools/urgengo/temporary_folder.h"

namespace urgengo::cli {

/// Adds the options that all benches have.
void add_bench_options(CLI::App& command, BenchOptions& options);

struct ChosenGpu {
    bool simulated = false;
    std::string line;          ///< what to say about it
    std::string real_libcuda;  ///< for `urgengo run`; empty: it searches
};

/// A bench that may start.
struct BenchSetup {
    ChosenGpu gpu;
    std::unique_ptr<TemporaryFolder> folder;  ///< holds all files of the runs
    Environment environment;                  ///< of the runs
    BenchPlan plan;
};

/// What keeps a bench from starting.
struct BenchObstacle {
    int exit_code = 0;
    std::string message;
};

/// Prints which GPU it will be.
/// @returns whether `setup` is complete; else `obstacle` is
bool prepare_bench(const BenchOptions& options, BenchSetup& setup, BenchObstacle& obstacle);

/// Every option by name, for the record.
std::vector<std::pair<std::string, std::string>> list_parameters(const BenchOptions& options);

/// Says on stderr what became of it.
/// @param path  empty: not asked for
/// @returns whether nothing went wrong
bool write_report(const std::string& path, const std::string& text);

}  // namespace urgengo::cli
