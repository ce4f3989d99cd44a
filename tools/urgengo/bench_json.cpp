// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/bench_json.h"

#include <nlohmann/json.hpp>

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

/// @returns null for an empty text, and the text itself if it is not JSON
Json embedded(const std::string& text) {
    if (text.empty()) return nullptr;
    Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
    return json.is_discarded() ? Json(text) : json;
}

}  // namespace

std::string to_json(const BenchResults& results) {
    Json parameters = Json::object();
    for (const auto& [name, value] : results.parameters) parameters[name] = value;
    Json runs = Json::array();
    for (const RunResult& run : results.runs) {
        runs.push_back({{"row", run.row},
                        {"f_a", run.f_a},
                        {"repeat", run.repeat},
                        {"seed", run.seed},
                        {"overall_miss_pct", run.miss_pct},
                        {"report", embedded(run.report)},
                        {"scheduler_stats", embedded(run.stats)}});
    }
    const RunResult& first = results.runs.front();
    const Json root = {{"format_version", 1},
                       {"program", "urgengo bench smoke"},
                       {"gpu", first.gpu},
                       {"simulated_gpu", results.simulated},
                       {"driver", first.driver},
                       {"version", results.version},
                       {"commit", results.commit},
                       {"date_utc", results.date_utc},
                       {"command_line", results.command_line},
                       {"parameters", std::move(parameters)},
                       {"runs", std::move(runs)}};
    return root.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace urgengo::cli
