// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/bench_json.h"

#include <nlohmann/json.hpp>

#include "tools/bench/smoke/bench_effects.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

/// @returns null for an empty text, and the text itself if it is not JSON
Json embedded(const std::string& text) {
    if (text.empty()) return nullptr;
    Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
    return json.is_discarded() ? Json(text) : json;
}

/// The program's report, without every instance: blocks tell what is needed of them.
Json without_instances(const std::string& report) {
    Json json = embedded(report);
    if (!json.is_object() || !json.contains("chains")) return json;
    for (Json& chain : json["chains"]) chain.erase("records");
    return json;
}

Json blocks_json(const RunResult& run) {
    Json chains = Json::array();
    for (const ChainResult& chain : run.chains) {
        std::vector<unsigned> frames, missed;
        for (const Block& block : chain.blocks) {
            frames.push_back(block.frames);
            missed.push_back(block.missed);
        }
        chains.push_back({{"frames", frames}, {"missed", missed}});
    }
    return chains;
}

Json interval_json(const Interval& interval) {
    return {{"value", interval.value}, {"low", interval.low}, {"high", interval.high}};
}

Json effects_json(const BenchResults& results) {
    Json list = Json::array();
    for (const Effect& effect : effects(results)) {
        list.push_back({{"row", effect.row},
                        {"f_a", effect.f_a},
                        {"overall_miss_pct", interval_json(effect.miss_pct)},
                        {"less_reference",
                         effect.difference ? interval_json(*effect.difference) : Json(nullptr)}});
    }
    return {{"definition",
             "mean over runs; percentiles 2.5 and 97.5 of a bootstrap over runs (seeds) and, in "
             "each, blocks of one second, the same of all rows"},
            {"resamples", kResamples},
            {"reference", reference_row(results)},
            {"rows", std::move(list)}};
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
                        {"blocks_of_chains", blocks_json(run)},
                        {"report", without_instances(run.report)},
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
                       {"workload_hash", results.workload_hash},
                       {"profiles", profiles_json(results.profiles)},
                       {"effects", effects_json(results)},
                       {"runs", std::move(runs)}};
    return root.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace urgengo::cli
