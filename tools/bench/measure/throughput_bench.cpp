// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/measure/throughput_bench.h"

#include <fmt/format.h>

#include <algorithm>

#include "tools/bench/smoke/bench_table.h"
#include "tools/urgengo/text_table.h"

namespace urgengo::cli {
namespace {

constexpr char kVanillaRow[] = "vanilla";

nlohmann::ordered_json spread_json(const Spread& spread) {
    return {{"median", spread.median}, {"min", spread.min}, {"max", spread.max}};
}

}  // namespace

Spread ThroughputLevel::of(std::size_t row) const {
    return spread(instances_per_s[row]);
}

Spread ThroughputLevel::ratio(std::size_t row, std::size_t base) const {
    std::vector<double> ratios;
    for (std::size_t round = 0; round < instances_per_s[row].size(); ++round)
        ratios.push_back(instances_per_s[row][round] / instances_per_s[base][round]);
    return spread(std::move(ratios));
}

std::size_t base_row(const ThroughputLevel& level) {
    const auto found = std::find(level.rows.begin(), level.rows.end(), kVanillaRow);
    return found == level.rows.end() ? 0 : static_cast<std::size_t>(found - level.rows.begin());
}

std::string format_throughput(const ThroughputLevel& level) {
    const std::size_t base = base_row(level);
    TextTable table;
    table.add_row(
        {fmt::format("f_a {}", level.f_a), "instances/s", "ratio to " + level.rows[base]});
    for (std::size_t row = 0; row < level.rows.size(); ++row)
        table.add_row({level.rows[row], format_spread(level.of(row), 2),
                       row == base ? "" : format_spread(level.ratio(row, base), 4)});
    return table.text();
}

nlohmann::ordered_json throughput_json(const ThroughputLevel& level) {
    const std::size_t base = base_row(level);
    nlohmann::ordered_json rows = nlohmann::ordered_json::array();
    for (std::size_t row = 0; row < level.rows.size(); ++row)
        rows.push_back({{"row", level.rows[row]},
                        {"instances_per_s", spread_json(level.of(row))},
                        {"ratio", spread_json(level.ratio(row, base))},
                        {"rounds", level.instances_per_s[row]}});
    return {{"f_a", level.f_a}, {"ratio_to", level.rows[base]}, {"rows", std::move(rows)}};
}

}  // namespace urgengo::cli
