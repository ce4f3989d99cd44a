// SPDX-License-Identifier: Apache-2.0
//
// What `urgengo sim` is told.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>
#include <vector>

namespace urgengo::cli {

struct SimOptions {
    // Empty, or 0: as in the file that is compared with, else the default that --help tells.
    std::vector<std::string> rows{};
    std::vector<double> f_a{};
    std::vector<std::uint32_t> seeds{};
    double f_d = 0;
    double seconds = 0;

    double f_tight = 0.4;
    int cores = 16;
    double launch_capacity = 0;  ///< CpuShape::launch_capacity
    int connections = 0;         ///< 0: as the row has them
    double mark_late_us = 2;     ///< from a mark's end to when the host sees it
    double bystander_ms = 0;     ///< of the GPU, in each of its turns; 0: there is none
    double bystander_every_ms = 10;
    bool bystander_matmul = false;  ///< it multiplies matrices instead, back to back
    double parking_every_ms = 0;    ///< of calls that wait for all GPU work; 0: there are none
    double stall_ms = 0;            ///< in which all threads stand still; 0: they never do
    double stall_every_ms = 600;    ///< in the mean
    double warmup = 0;              ///< of the seconds
    std::string workload{};         ///< empty: the ten chains as an H200 runs them
    std::string profile{};          ///< of a workload that is a chains.yaml; empty: beside it
    std::string compare{};          ///< a results file; empty: none
    bool least = false;             ///< how few misses there can be, too
    std::string out{};
    bool quiet = false;
};

CLI::App* add_sim(CLI::App& app, SimOptions& options);

}  // namespace urgengo::cli
