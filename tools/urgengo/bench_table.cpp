// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/bench_table.h"

#include <fmt/format.h>

#include "tools/urgengo/text_table.h"

namespace urgengo::cli {
namespace {

std::string level_name(double f_a) {
    return fmt::format("f_a {}", f_a);
}

TextTable overall_table(const BenchResults& results) {
    TextTable table;
    std::vector<std::string> levels{""}, columns{""};
    for (const double f_a : results.levels) {
        levels.insert(levels.end(), {level_name(f_a), "", ""});
        columns.insert(columns.end(), {"miss %", "exited", "cores"});
    }
    table.add_row(std::move(levels));
    table.add_row(std::move(columns));
    for (const std::string& row : results.rows) {
        std::vector<std::string> cells{row};
        for (const double f_a : results.levels) {
            const auto exited =
                results.over_repeats(row, f_a, [](const RunResult& run) { return run.exited; });
            const auto cores =
                results.over_repeats(row, f_a, [](const RunResult& run) { return run.cpu_cores; });
            cells.push_back(format_spread(results.miss_pct(row, f_a), 1));
            cells.push_back(format_spread(exited, 0));
            cells.push_back(format_spread(cores, 2));
        }
        table.add_row(std::move(cells));
    }
    return table;
}

TextTable chain_table(const BenchResults& results) {
    TextTable table;
    std::vector<std::string> levels{"miss %", ""}, columns{"chain", "deadline ms"};
    for (const double f_a : results.levels) {
        levels.push_back(level_name(f_a));
        levels.resize(levels.size() + results.rows.size() - 1);
        columns.insert(columns.end(), results.rows.begin(), results.rows.end());
    }
    table.add_row(std::move(levels));
    table.add_row(std::move(columns));
    const auto& chains = results.chains(results.levels.front());
    for (std::size_t i = 0; i < chains.size(); ++i) {
        std::vector<std::string> cells{chains[i].name,
                                       fmt::format("{:.1f}", chains[i].deadline_ms)};
        for (const double f_a : results.levels) {
            for (const std::string& row : results.rows) {
                cells.push_back(format_spread(results.chain_miss_pct(row, f_a, i), 1));
            }
        }
        table.add_row(std::move(cells));
    }
    return table;
}

}  // namespace

std::string format_spread(const Spread& spread, int decimals) {
    if (spread.min == spread.max) return fmt::format("{:.{}f}", spread.median, decimals);
    return fmt::format("{:.{}f} ({:.{}f}..{:.{}f})", spread.median, decimals, spread.min, decimals,
                       spread.max, decimals);
}

std::string format_table(const BenchResults& results) {
    return overall_table(results).text() + "\n" + chain_table(results).text();
}

}  // namespace urgengo::cli
