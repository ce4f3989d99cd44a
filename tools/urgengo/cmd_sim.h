// SPDX-License-Identifier: Apache-2.0
//
// urgengo sim: what `urgengo bench smoke` measures, in virtual time: no GPU, the same result on any
// machine (tools/sim). Its JSON is that of `bench smoke`.
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
    int connections = 0;      ///< 0: as the row has them
    double mark_late_us = 2;  ///< from a mark's end to when the host sees it
    double bystander_ms = 0;  ///< of the GPU, in each of its turns; 0: there is none
    double bystander_every_ms = 10;
    bool bystander_matmul = false;  ///< it multiplies matrices instead, back to back
    double parking_every_ms = 0;    ///< of calls that wait for all GPU work; 0: there are none
    double warmup = 0;              ///< of the seconds
    std::string workload{};         ///< empty: the ten chains as an H200 runs them
    std::string profile{};          ///< of a workload that is a chains.yaml; empty: beside it
    std::string compare{};          ///< a results file; empty: none
    bool least = false;             ///< how few misses there can be, too
    std::string out{};
    bool quiet = false;
};

CLI::App* add_sim(CLI::App& app, SimOptions& options);

/// @param arguments  of the command line, for the record
/// @returns an exit code
int cmd_sim(const SimOptions& given, const std::vector<std::string>& arguments);

}  // namespace urgengo::cli
