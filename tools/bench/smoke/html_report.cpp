// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/html_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tools/bench/smoke/bar_chart.h"
#include "tools/bench/smoke/bench_plan.h"
#include "tools/bench/smoke/bench_table.h"
#include "tools/report/html_template.h"

/// report.html, by urgengo_embed_file().
extern "C" const char urgengo_report_html[], urgengo_report_html_end[];

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

constexpr char kUrgengoRow[] = "urgengo";

/// The rows that charts compare: bare against urgengo, or all of them where one of the two is
/// missing.
std::vector<std::string> charted_rows(const BenchResults& results) {
    const auto has = [&](const char* row) {
        return std::find(results.rows.begin(), results.rows.end(), row) != results.rows.end();
    };
    if (has(kBareRow) && has(kUrgengoRow)) return {kBareRow, kUrgengoRow};
    return results.rows;
}

Json levels(const BenchResults& results) {
    Json list = Json::array();
    for (const double f_a : results.levels) list.push_back({{"f_a", fmt::format("{}", f_a)}});
    return list;
}

Json overall(const BenchResults& results) {
    Json list = Json::array();
    for (const std::string& row : results.rows) {
        Json cells = Json::array();
        for (const double f_a : results.levels) {
            const auto exited =
                results.over_repeats(row, f_a, [](const RunResult& run) { return run.exited; });
            const auto cores =
                results.over_repeats(row, f_a, [](const RunResult& run) { return run.cpu_cores; });
            cells.push_back({{"misses", format_spread(results.miss_pct(row, f_a), 1)},
                             {"exited", format_spread(exited, 0)},
                             {"cores", format_spread(cores, 2)}});
        }
        list.push_back({{"row", row}, {"cells", std::move(cells)}});
    }
    return list;
}

Json chart(const BenchResults& results, const std::vector<std::string>& rows, double f_a) {
    const auto& chains = results.chains(f_a);
    std::vector<std::string> names;
    for (const ChainResult& chain : chains) names.push_back(chain.name);
    std::vector<BarSeries> series;
    Json captions = Json::array();
    for (const std::string& row : rows) {
        BarSeries bars{row, {}};
        for (std::size_t i = 0; i < chains.size(); ++i) {
            bars.values.push_back(results.chain_miss_pct(row, f_a, i).median);
        }
        captions.push_back({{"number", series.size()},
                            {"row", row},
                            {"misses", fmt::format("{:.1f}", results.miss_pct(row, f_a).median)}});
        series.push_back(std::move(bars));
    }
    Json filled = bar_chart(names, series);
    filled["f_a"] = fmt::format("{}", f_a);
    filled["series"] = std::move(captions);
    return filled;
}

Json charts(const BenchResults& results) {
    Json list = Json::array();
    const auto rows = charted_rows(results);
    for (const double f_a : results.levels) list.push_back(chart(results, rows, f_a));
    return list;
}

Json chains(const BenchResults& results) {
    Json list = Json::array();
    const auto& chains = results.chains(results.levels.front());
    for (std::size_t i = 0; i < chains.size(); ++i) {
        Json misses = Json::array();
        for (const double f_a : results.levels) {
            for (const std::string& row : results.rows) {
                misses.push_back(format_spread(results.chain_miss_pct(row, f_a, i), 1));
            }
        }
        list.push_back({{"name", chains[i].name},
                        {"deadline_ms", fmt::format("{:.1f}", chains[i].deadline_ms)},
                        {"misses", std::move(misses)}});
    }
    return list;
}

Json facts(const BenchResults& results) {
    Json list = Json::array();
    const auto add = [&](const std::string& name, const std::string& value) {
        list.push_back({{"name", name}, {"value", value}});
    };
    const RunResult& first = results.runs.front();
    add("GPU", first.gpu);
    add("driver", first.driver);
    add("date", results.date_utc);
    add("UrgenGo", results.version + " (" + results.commit + ")");
    for (const ProfileSummary& profile : results.profiles) add("profile", describe(profile));
    for (const auto& [name, value] : results.parameters) add(name, value);
    return list;
}

}  // namespace

std::string html_report(const BenchResults& results) {
    return fill_template(
        {urgengo_report_html, urgengo_report_html_end},
        {{"title", results.simulated ? "UrgenGo bench (simulated GPU)" : "UrgenGo bench"},
         {"place", results.simulated ? "a simulated GPU" : results.runs.front().gpu},
         {"gpu_line", results.gpu_line},
         {"simulated", results.simulated},
         {"levels", levels(results)},
         {"rows", results.rows},
         {"num_rows", results.rows.size()},
         {"overall", overall(results)},
         {"charts", charts(results)},
         {"chains", chains(results)},
         {"facts", facts(results)},
         {"command_line", results.command_line}});
}

}  // namespace urgengo::cli
