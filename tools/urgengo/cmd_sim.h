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
    std::vector<std::string> rows{"bare"};
    std::vector<double> f_a{0.7, 0.9, 1.1};
    double f_d = 1;
    double f_tight = 0.4;
    double seconds = 10;
    std::vector<std::uint32_t> seeds{1, 2, 3};
    int cores = 16;
    int connections = 0;   ///< 0: as the row has them
    std::string workload;  ///< empty: the ten chains as an H200 runs them
    std::string out;
    bool quiet = false;
};

CLI::App* add_sim(CLI::App& app, SimOptions& options);

/// @param arguments  of the command line, for the record
/// @returns an exit code
int cmd_sim(const SimOptions& options, const std::vector<std::string>& arguments);

}  // namespace urgengo::cli
