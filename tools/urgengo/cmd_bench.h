// SPDX-License-Identifier: Apache-2.0
//
// urgengo bench: hands over to urgengo-bench, which lies beside this program (tools/bench).
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace urgengo::cli {

struct BenchCommand {};

CLI::App* add_bench(CLI::App& app, BenchCommand& options);

/// @param arguments  urgengo-bench's
/// @returns an exit status if there is no such program; else it does not return
int cmd_bench(const BenchCommand& options, const std::vector<std::string>& arguments);

}  // namespace urgengo::cli
