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
        std::uint64_t parks = 0, held_by_parks = 0;
        std::chrono::nanoseconds parked{0};
    };
    std::map<std::string, Sum> rows;
    bool has_parks = false;
    for (const SimRun& run : runs) {
        if (!run.gates) continue;
        Sum& sum = rows[run.result.row];
        sum.seconds += seconds;
        sum.closed += run.gates->closed;
        sum.opened_by_gpu += run.gates->opened_by_gpu;
        sum.gpu_rounds += run.gates->gpu_rounds;
        sum.parks += run.gates->parks;
        sum.held_by_parks += run.gates->held_by_parks;
        sum.parked += run.gates->parked;
        has_parks |= run.gates->parks > 0;
    }
    if (rows.empty()) return {};
    TextTable table;
    std::vector<std::string> head{"a second", "gates closed", "opened by the GPU", "its rounds"};
    if (has_parks) head.insert(head.end(), {"parks", "parked ms", "held in threads then"});
    table.add_row(head);
    for (const auto& [row, sum] : rows) {
        const auto rate = [&](std::uint64_t n) {
            return fmt::format("{:.0f}", double(n) / sum.seconds);
        };
        std::vector<std::string> line{row, rate(sum.closed), rate(sum.opened_by_gpu),
                                      rate(sum.gpu_rounds)};
        if (has_parks) {
            const double parked_ms = 1e-6 * static_cast<double>(sum.parked.count());
            line.insert(line.end(),
                        {rate(sum.parks), fmt::format("{:.0f}", parked_ms / sum.seconds),
                         rate(sum.held_by_parks)});
        }
        table.add_row(line);
    }
    return "\n" + table.text();
}

void add_gates(nlohmann::ordered_json& json, const std::vector<SimRun>& runs) {
    for (std::size_t i = 0; i < runs.size(); ++i) {
        if (!runs[i].gates) continue;
        const sim::GateCounts& gates = *runs[i].gates;
        json[i]["gates"] = {
            {"closed", gates.closed},
            {"refused", gates.refused},
            {"opened_by_gpu", gates.opened_by_gpu},
            {"gpu_rounds", gates.gpu_rounds},
            {"at_bound", gates.at_bound},
            {"parks", gates.parks},
            {"parked_ms", 1e-6 * static_cast<double>(gates.parked.count())},
            {"longest_park_ms", 1e-6 * static_cast<double>(gates.longest_park.count())},
            {"opened_by_parks", gates.opened_by_parks},
            {"held_by_parks", gates.held_by_parks}};
    }
}

}  // namespace urgengo::cli
