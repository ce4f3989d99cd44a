// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/sim_gates.h"

#include <fmt/format.h>

#include <map>
#include <nlohmann/json.hpp>

#include "tools/urgengo/text_table.h"

namespace urgengo::cli {

std::vector<RunResult> results_of(const std::vector<SimRun>& runs) {
    std::vector<RunResult> results;
    for (const SimRun& run : runs) results.push_back(run.result);
    return results;
}

std::string format_gates(const std::vector<SimRun>& runs, double seconds) {
    struct Sum {
        double seconds = 0;
        std::uint64_t closed = 0, opened_by_gpu = 0, gpu_rounds = 0;
    };
    std::map<std::string, Sum> rows;
    for (const SimRun& run : runs) {
        if (!run.gates) continue;
        Sum& sum = rows[run.result.row];
        sum.seconds += seconds;
        sum.closed += run.gates->closed;
        sum.opened_by_gpu += run.gates->opened_by_gpu;
        sum.gpu_rounds += run.gates->gpu_rounds;
    }
    if (rows.empty()) return {};
    TextTable table;
    table.add_row({"a second", "gates closed", "opened by the GPU", "its rounds"});
    for (const auto& [row, sum] : rows) {
        const auto rate = [&](std::uint64_t n) {
            return fmt::format("{:.0f}", double(n) / sum.seconds);
        };
        table.add_row({row, rate(sum.closed), rate(sum.opened_by_gpu), rate(sum.gpu_rounds)});
    }
    return "\n" + table.text();
}

void add_gates(nlohmann::ordered_json& json, const std::vector<SimRun>& runs) {
    for (std::size_t i = 0; i < runs.size(); ++i) {
        if (!runs[i].gates) continue;
        const sim::GateCounts& gates = *runs[i].gates;
        json[i]["gates"] = {{"closed", gates.closed},
                            {"refused", gates.refused},
                            {"opened_by_gpu", gates.opened_by_gpu},
                            {"gpu_rounds", gates.gpu_rounds},
                            {"at_bound", gates.at_bound}};
    }
}

}  // namespace urgengo::cli
