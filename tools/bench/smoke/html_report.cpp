// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/html_report.h"

#include <fmt/format.h>

#include <algorithm>

#include "tools/bench/smoke/bench_plan.h"
#include "tools/bench/smoke/bench_table.h"
#include "tools/bench/smoke/svg_bar_chart.h"

namespace urgengo::cli {
namespace {

constexpr char kUrgengoRow[] = "urgengo";

constexpr char kStyle[] = R"(
:root { --ink: #1c2430; --soft: #5d6b7c; --line: #dde3ea; --page: #f6f8fa; --card: #fff;
        --c0: #b9772a; --c1: #1a7f8e; --c2: #7b5ea7; --c3: #5c8a3a; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e4e9ef; --soft: #94a3b5; --line: #2c3644; --page: #12171e; --card: #1a212b;
          --c0: #dc9b4c; --c1: #3fb3c4; --c2: #a88bd4; --c3: #8cbf66; } }
body { margin: 0; background: var(--page); color: var(--ink);
       font: 15px/1.5 system-ui, -apple-system, "Segoe UI", sans-serif; }
main { max-width: 860px; margin: 0 auto; padding: 32px 20px 64px; }
h1 { font-size: 26px; line-height: 1.25; margin: 0 0 6px; }
h2 { font-size: 18px; margin: 36px 0 10px; }
p.soft, dt, figcaption, .axis { color: var(--soft); }
p.soft { margin: 0 0 8px; }
.card { background: var(--card); border: 1px solid var(--line); border-radius: 10px;
        padding: 14px 18px; margin: 12px 0; overflow-x: auto; }
.simulated { border-left: 4px solid var(--c0); }
figure { margin: 12px 0; } figcaption { font-size: 14px; margin-bottom: 6px; }
figcaption strong { color: var(--ink); }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { padding: 5px 10px; text-align: right; border-bottom: 1px solid var(--line);
         white-space: nowrap; }
th { font-weight: 600; } th.level { text-align: center; }
th:first-child, td:first-child { text-align: left; } tr:last-child td { border-bottom: 0; }
svg { width: 100%; height: auto; display: block; }
.axis { font-size: 11px; fill: var(--soft); } .grid { stroke: var(--line); }
.bar0 { fill: var(--c0); } .bar1 { fill: var(--c1); } .bar2 { fill: var(--c2); }
.bar3 { fill: var(--c3); }
.key { display: inline-block; width: 11px; height: 11px; border-radius: 2px; margin: 0 5px 0 12px; }
.key.bar0 { background: var(--c0); } .key.bar1 { background: var(--c1); }
.key.bar2 { background: var(--c2); } .key.bar3 { background: var(--c3); }
dl { display: grid; grid-template-columns: max-content 1fr; gap: 3px 18px; margin: 0; }
dd { margin: 0; overflow-wrap: anywhere; }
code { font: 13px/1.5 ui-monospace, Menlo, Consolas, monospace; }
)";

/// The rows that charts compare: bare against urgengo, or all of them where one of the two is
/// missing.
std::vector<std::string> charted_rows(const BenchResults& results) {
    const auto has = [&](const char* row) {
        return std::find(results.rows.begin(), results.rows.end(), row) != results.rows.end();
    };
    if (has(kBareRow) && has(kUrgengoRow)) return {kBareRow, kUrgengoRow};
    return results.rows;
}

std::string headline(const BenchResults& results) {
    const std::string where =
        results.simulated ? "on a simulated GPU" : "on " + results.runs.front().gpu;
    std::string html = "<h1>Deadline misses of the ten-chain workload " + html_escape(where) +
                       "</h1>\n<p class=\"soft\">" + html_escape(results.gpu_line) + "</p>\n";
    if (results.simulated) {
        html +=
            "<div class=\"card simulated\"><strong>Simulated GPU.</strong> Kernels take modelled "
            "time and compute nothing. These numbers show how the scheduler behaves, not how fast "
            "any hardware is.</div>\n";
    }
    return html;
}

std::string overall_section(const BenchResults& results) {
    std::string levels = "<tr><th></th>", columns = "<tr><th>row</th>", body;
    for (const double f_a : results.levels) {
        levels += fmt::format("<th class=\"level\" colspan=\"3\">f_a {}</th>", f_a);
        columns += "<th>miss %</th><th>exited</th><th>cores</th>";
    }
    for (const std::string& row : results.rows) {
        body += "<tr><td>" + html_escape(row) + "</td>";
        for (const double f_a : results.levels) {
            const auto exited =
                results.over_repeats(row, f_a, [](const RunResult& run) { return run.exited; });
            const auto cores =
                results.over_repeats(row, f_a, [](const RunResult& run) { return run.cpu_cores; });
            body += fmt::format("<td><strong>{}</strong></td><td>{}</td><td>{}</td>",
                                format_spread(results.miss_pct(row, f_a), 1),
                                format_spread(exited, 0), format_spread(cores, 2));
        }
        body += "</tr>\n";
    }
    return "<h2>Overall</h2>\n<p class=\"soft\">miss %: the mean of the chains' miss ratios; late, "
           "dropped and exited frames are missed. exited: frames given up early, because their "
           "deadline could no longer be met. cores: CPU used, on average. f_a: factor on arrival "
           "rates.</p>\n<div class=\"card\"><table>\n" +
           levels + "</tr>\n" + columns + "</tr>\n" + body + "</table></div>\n";
}

std::string chart(const BenchResults& results, const std::vector<std::string>& rows, double f_a) {
    const auto& chains = results.chains(f_a);
    std::vector<std::string> names;
    for (const ChainResult& chain : chains) names.push_back(chain.name);
    std::vector<BarSeries> series;
    std::string caption = fmt::format("<strong>f_a {}</strong>", f_a);
    for (const std::string& row : rows) {
        BarSeries bars{row, {}};
        for (std::size_t i = 0; i < chains.size(); ++i) {
            bars.values.push_back(results.chain_miss_pct(row, f_a, i).median);
        }
        caption += fmt::format("<span class=\"key bar{}\"></span>{} (overall {:.1f} %)",
                               series.size(), html_escape(row), results.miss_pct(row, f_a).median);
        series.push_back(std::move(bars));
    }
    return "<figure class=\"card\"><figcaption>" + caption + "</figcaption>\n" +
           svg_bar_chart(names, series) + "</figure>\n";
}

std::string chart_section(const BenchResults& results) {
    std::string html = "<h2>Misses of each chain</h2>\n";
    const auto rows = charted_rows(results);
    for (const double f_a : results.levels) html += chart(results, rows, f_a);
    return html;
}

std::string chain_section(const BenchResults& results) {
    std::string levels = "<tr><th></th><th></th>",
                columns = "<tr><th>chain</th><th>deadline ms</th>";
    for (const double f_a : results.levels) {
        levels +=
            fmt::format("<th class=\"level\" colspan=\"{}\">f_a {}</th>", results.rows.size(), f_a);
        for (const std::string& row : results.rows) columns += "<th>" + html_escape(row) + "</th>";
    }
    std::string body;
    const auto& chains = results.chains(results.levels.front());
    for (std::size_t i = 0; i < chains.size(); ++i) {
        body += fmt::format("<tr><td>{}</td><td>{:.1f}</td>", html_escape(chains[i].name),
                            chains[i].deadline_ms);
        for (const double f_a : results.levels) {
            for (const std::string& row : results.rows) {
                body += "<td>" + format_spread(results.chain_miss_pct(row, f_a, i), 1) + "</td>";
            }
        }
        body += "</tr>\n";
    }
    return "<h2>Misses of each chain, per cent</h2>\n<div class=\"card\"><table>\n" + levels +
           "</tr>\n" + columns + "</tr>\n" + body + "</table></div>\n";
}

std::string conditions_section(const BenchResults& results) {
    const RunResult& first = results.runs.front();
    std::vector<std::pair<std::string, std::string>> facts = {
        {"GPU", first.gpu},
        {"driver", first.driver},
        {"date", results.date_utc},
        {"UrgenGo", results.version + " (" + results.commit + ")"}};
    for (const ProfileSummary& profile : results.profiles) {
        facts.emplace_back("profile", describe(profile));
    }
    facts.insert(facts.end(), results.parameters.begin(), results.parameters.end());
    std::string html = "<h2>Conditions</h2>\n<div class=\"card\"><dl>\n";
    for (const auto& [name, value] : facts) {
        html += "<dt>" + html_escape(name) + "</dt><dd>" + html_escape(value) + "</dd>\n";
    }
    return html + "<dt>command</dt><dd><code>" + html_escape(results.command_line) +
           "</code></dd>\n</dl></div>\n"
           "<p class=\"soft\">Every row runs the same program on the same arrivals; bare is the "
           "program without UrgenGo, the others are presets; with -nohints the program says "
           "nothing of "
           "its frames. With repeats: median (min..max), and "
           "charts show medians.</p>\n";
}

}  // namespace

std::string html_report(const BenchResults& results) {
    const std::string title = results.simulated ? "UrgenGo bench (simulated GPU)" : "UrgenGo bench";
    return "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
           "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>" +
           title + "</title>\n<style>" + kStyle + "</style>\n</head>\n<body><main>\n" +
           headline(results) + overall_section(results) + chart_section(results) +
           chain_section(results) + conditions_section(results) + "</main></body>\n</html>\n";
}

}  // namespace urgengo::cli
