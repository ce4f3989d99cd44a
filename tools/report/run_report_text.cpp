// SPDX-License-Identifier: Apache-2.0
//
// The summary for the terminal.
#include <fmt/format.h>

#include <algorithm>

#include "tools/report/run_report.h"
#include "tools/urgengo/text_table.h"

namespace urgengo::report {
namespace {

std::string interval(const MissRatio& ratio) {
    return fmt::format("{:.1f} ({:.1f}..{:.1f})", 100 * ratio.ratio, 100 * ratio.low,
                       100 * ratio.high);
}

std::string heading(const ReportedRun& run) {
    const RunNumbers& numbers = run.numbers;
    std::string words =
        fmt::format("{}: {} (pid {}), {:.1f} s; missed {} %", run.label, run.run.program,
                    run.run.process, numbers.seconds, interval(numbers.misses));
    if (numbers.gpu.is_known)
        words += fmt::format("; GPU segments {:.0f} % of the time, collisions {:.1f} %",
                             100 * numbers.gpu.busy_share(), 100 * numbers.gpu.collision_share());
    if (numbers.cpu_cores >= 0) words += fmt::format("; {:.2f} cores", numbers.cpu_cores);
    words += "\n";
    if (const std::string gates = trace::gates_words(numbers.gates); !gates.empty())
        words += "  gates: " + gates + "\n";
    return words;
}

/// @returns those of all runs, each once
std::vector<std::string> chain_names(const std::vector<ReportedRun>& runs) {
    std::vector<std::string> names;
    for (const ReportedRun& run : runs)
        for (const ChainNumbers& chain : run.numbers.chains)
            if (std::find(names.begin(), names.end(), chain.summary.name) == names.end())
                names.push_back(chain.summary.name);
    return names;
}

std::vector<std::string> row_of(const std::string& name, const std::string& label,
                                const ChainNumbers& chain) {
    const trace::ChainSummary& s = chain.summary;
    const auto ms = [](double value) { return fmt::format("{:.1f}", value); };
    return {name,
            label,
            ms(trace::to_ms(s.deadline_ns)),
            std::to_string(s.frames),
            std::to_string(s.late),
            std::to_string(s.dropped),
            interval(chain.misses),
            ms(chain.percentile_ms(0.5)),
            ms(chain.percentile_ms(0.99)),
            ms(chain.percentile_ms(1)),
            trace::most_often(s)};
}

}  // namespace

std::string to_text(const std::vector<ReportedRun>& runs) {
    std::string text;
    for (const ReportedRun& run : runs) text += heading(run);
    text += "\n";
    cli::TextTable table;
    table.add_row({"chain", "run", "deadline", "frames", "late", "dropped", "missed % (95 %)",
                   "median", "p99", "max", "late most often"});
    for (const std::string& name : chain_names(runs)) {
        bool is_first = true;
        for (const ReportedRun& run : runs)
            for (const ChainNumbers& chain : run.numbers.chains) {
                if (chain.summary.name != name) continue;
                table.add_row(row_of(is_first ? name : "", run.label, chain));
                is_first = false;
            }
    }
    return text + table.text();
}

}  // namespace urgengo::report
