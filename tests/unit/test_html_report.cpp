// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/html_report.h"

#include "tests/support/catch.h"

namespace urgengo::cli {
namespace {

/// Two rows by two loads; `<b>` stands in every name.
BenchResults results_of(std::vector<std::string> rows) {
    BenchResults results;
    results.gpu_line = "GPU: <b>";
    results.version = "1";
    results.commit = "abc";
    results.date_utc = "2026-01-01";
    results.command_line = "urgengo bench smoke --out '<b>'";
    results.parameters = {{"seed <b>", "<b>"}};
    results.rows = std::move(rows);
    results.levels = {0.9, 1};
    for (const std::string& row : results.rows)
        for (const double f_a : results.levels) {
            RunResult run;
            run.row = row;
            run.f_a = f_a;
            run.gpu = "H100 <b>";
            run.driver = "CUDA <b>";
            run.miss_pct = 12.5;
            run.exited = 3;
            run.cpu_cores = 1.25;
            run.chains = {{"C<b>", 42, 25, {}}, {"D", 13, 0, {}}};
            results.runs.push_back(run);
        }
    return results;
}

std::size_t count(const std::string& text, const std::string& part) {
    std::size_t found = 0;
    for (auto at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++found;
    return found;
}

TEST_CASE("The report has every row, load and chain, and what it was measured with",
          "[unit][cli]") {
    const std::string html = html_report(results_of({"bare", "urgengo", "edf"}));
    CHECK(html.find("<!doctype html>\n") == 0);
    CHECK(html.rfind("</html>\n") == html.size() - 8);
    CHECK(count(html, "<td><strong>12.5</strong></td><td>3</td><td>1.25</td>") == 6);
    CHECK(count(html, "<td>D</td><td>13.0</td><td>0.0</td>") == 1);
    CHECK(count(html, "<svg ") == 2);
    CHECK(count(html, "<rect class=\"bar0\"") == 4);  // bare and urgengo, of three rows
    CHECK(count(html, "<rect class=\"bar1\"") == 4);
    CHECK(count(html, "<rect class=\"bar2\"") == 0);
    CHECK(count(html, "C&lt;b&gt;, urgengo: 25.0 %</title>") == 2);
    CHECK(count(html, "<dt>UrgenGo</dt><dd>1 (abc)</dd>") == 1);
}

TEST_CASE("The report lets no name be HTML", "[unit][cli]") {
    const std::string html = html_report(results_of({"bare", "<b>"}));
    CHECK(count(html, "<b>") == 0);
    CHECK(count(html, "&lt;b&gt;") > 10);
    CHECK(html.find("{{") == std::string::npos);
}

TEST_CASE("The report of a simulated GPU says so", "[unit][cli]") {
    BenchResults results = results_of({"bare"});
    CHECK(html_report(results).find("class=\"card simulated\"") == std::string::npos);
    CHECK(count(html_report(results), "workload on H100 &lt;b&gt;</h1>") == 1);
    results.simulated = true;
    CHECK(count(html_report(results), "class=\"card simulated\"") == 1);
    CHECK(count(html_report(results), "workload on a simulated GPU</h1>") == 1);
}

}  // namespace
}  // namespace urgengo::cli
