// SPDX-License-Identifier: Apache-2.0
//
// urgengo report: one run or several in numbers, and as a page that needs no network
// (tools/report/run_report.h).
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace urgengo::cli {

struct ReportOptions {
    std::vector<std::string> files;
    std::string out;  ///< the page; empty: none
    bool json = false, csv = false, quiet = false;
    std::size_t most_misses = 40;  ///< told one by one, of each run
};

CLI::App* add_report(CLI::App& app, ReportOptions& options);

/// @returns an exit code
int cmd_report(const ReportOptions& options);

}  // namespace urgengo::cli
