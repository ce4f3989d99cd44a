// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/bench_table.h"

#include <fmt/format.h>

#include "tools/bench/smoke/bench_effects.h"
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

std::string format_interval(const Interval& interval, const char* sign) {
    const auto number = [](double value, const char* format) {
        return fmt::format(fmt::runtime(format), value);
    };
    const std::string format = std::string("{:") + sign + ".1f}";
    return fmt::format("{} [{}, {}]", number(interval.value, format.c_str()),
                       number(interval.low, format.c_str()), number(interval.high, format.c_str()));
}

/// @returns nothing if runs do not know their blocks
std::string effect_table(const BenchResults& results) {
    const std::vector<Effect> list = effects(results);
    if (list.empty()) return {};
    TextTable table;
    const std::size_t num_rows = results.rows.size();
    std::vector<std::string> levels{"mean [95 %]"}, columns{""};
    for (const double f_a : results.levels) {
        levels.insert(levels.end(), {level_name(f_a), ""});
        columns.insert(columns.end(), {"miss %", "less " + reference_row(results)});
    }
    table.add_row(std::move(levels));
    table.add_row(std::move(columns));
    for (std::size_t row = 0; row < num_rows; ++row) {
        std::vector<std::string> cells{results.rows[row]};
        for (std::size_t level = 0; level < results.levels.size(); ++level) {
            const Effect& effect = list[level * num_rows + row];
            cells.push_back(format_interval(effect.miss_pct, ""));
            cells.push_back(effect.difference ? format_interval(*effect.difference, "+") : "");
        }
        table.add_row(std::move(cells));
    }
    return table.text() + "\n";
}

}  // namespace

std::string format_spread(const Spread& spread, int decimals) {
    if (spread.min == spread.max) return fmt::format("{:.{}f}", spread.median, decimals);
    return fmt::format("{:.{}f} ({:.{}f}..{:.{}f})", spread.median, decimals, spread.min, decimals,
                       spread.max, decimals);
}

std::string format_table(const BenchResults& results, bool with_chains) {
    return overall_table(results).text() + "\n" + effect_table(results) +
           (with_chains ? chain_table(results).text() : "");
}

}  // namespace urgengo::cli
