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

Json profiles_json(const std::vector<ProfileSummary>& profiles) {
    Json list = Json::array();
    for (const ProfileSummary& profile : profiles) {
        Json instances = Json::object();
        for (const ProfiledTask& task : profile.tasks) {
            instances[task.chain + "." + task.task] = task.instances;
        }
        list.push_back({{"hints", profile.hints},
                        {"way", profile.way},
                        {"f_a", kProfileLoad},
                        {"seconds", profile.seconds},
                        {"instances", std::move(instances)}});
        if (profile.way == "given") {
            list.back()["f_a"] = nullptr;
            list.back()["seconds"] = nullptr;
        }
    }
    return list;
}

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
                       {"profiles", profiles_json(results.profiles)},
                       {"runs", std::move(runs)}};
    return root.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace urgengo::cli
