// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/bench_merge.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <tuple>

#include "host/config/json_cursor.h"
#include "tools/bench/smoke/bench_conditions.h"

namespace urgengo::cli {
namespace {

using Json = nlohmann::ordered_json;

/// What may differ between results that belong together; the workload's hash tells whether it is
/// the same one.
const std::set<std::string> kFreeParameters{"f_a", "rows", "repeats", "seed", "workload", "merged"};

template <typename T>
void add_once(std::vector<T>& list, const T& value) {
    if (std::find(list.begin(), list.end(), value) == list.end()) list.push_back(value);
}

std::vector<Block> blocks_of(const Json& chain) {
    const auto frames = chain.at("frames").get<std::vector<unsigned>>();
    const auto missed = chain.at("missed").get<std::vector<unsigned>>();
    std::vector<Block> blocks;
    for (std::size_t i = 0; i < frames.size(); ++i) blocks.push_back({frames[i], missed.at(i)});
    return blocks;
}

Result<RunResult> run_of(const Json& json, const std::string& file) {
    auto run = parse_report(json.at("report").dump(), file);
    if (!run) return run;
    run->row = json.at("row").get<std::string>();
    run->f_a = json.at("f_a").get<double>();
    run->repeat = json.at("repeat").get<int>();
    run->seed = json.at("seed").get<std::uint32_t>();
    if (!json.at("scheduler_stats").is_null()) run->stats = json.at("scheduler_stats").dump();
    const Json& blocks = json.at("blocks_of_chains");
    for (std::size_t i = 0; i < run->chains.size(); ++i)
        run->chains[i].blocks = blocks_of(blocks.at(i));
    return run;
}

ProfileSummary profile_of(const Json& json) {
    ProfileSummary profile{json.at("hints").get<bool>(), json.at("way").get<std::string>(), 0, {}};
    if (json.at("seconds").is_number()) profile.seconds = json.at("seconds").get<double>();
    for (const auto& [task, instances] : json.at("instances").items()) {
        const auto dot = task.find('.');
        profile.tasks.push_back(
            {task.substr(0, dot), task.substr(dot + 1), instances.get<std::uint32_t>()});
    }
    return profile;
}

/// @returns what is wrong; empty if nothing is
std::string append(const Json& root, const std::string& file, BenchResults& results) {
    results.simulated = root.at("simulated_gpu").get<bool>();
    results.version = root.at("version").get<std::string>();
    results.commit = root.at("commit").get<std::string>();
    results.workload_hash = root.at("workload_hash").get<std::string>();
    if (results.date_utc.empty()) results.date_utc = root.at("date_utc").get<std::string>();
    results.command_line +=
        (results.command_line.empty() ? "" : "; ") + root.at("command_line").get<std::string>();
    if (results.parameters.empty())
        for (const auto& [name, value] : root.at("parameters").items())
            if (!kFreeParameters.contains(name))
                results.parameters.emplace_back(name, value.get<std::string>());
    for (const Json& json : root.at("profiles")) results.profiles.push_back(profile_of(json));
    for (const Json& json : root.at("runs")) {
        auto run = run_of(json, file);
        if (!run) return run.error();
        add_once(results.rows, run->row);
        add_once(results.levels, run->f_a);
        results.runs.push_back(std::move(*run));
    }
    return {};
}

std::string missing_or_twice(const BenchResults& results) {
    using Cell = std::tuple<double, std::uint32_t, std::string>;
    std::set<Cell> found;
    for (const RunResult& run : results.runs)
        if (!found.insert({run.f_a, run.seed, run.row}).second)
            return fmt::format("found {} at f_a {}, seed {} twice, accepted: once", run.row,
                               run.f_a, run.seed);
    for (const auto& [f_a, seed, unused] : found)
        for (const std::string& row : results.rows)
            if (!found.contains({f_a, seed, row}))
                return fmt::format("found no {} at f_a {}, seed {}, accepted: all rows of a seed",
                                   row, f_a, seed);
    return {};
}

}  // namespace

Result<BenchResults> merge_results(const std::vector<std::string>& texts,
                                   const std::vector<std::string>& files) {
    BenchResults results;
    Json wanted;
    for (std::size_t i = 0; i < texts.size(); ++i) {
        try {
            const Json root = Json::parse(texts[i]);
            const Json found = conditions(root, kFreeParameters);
            if (i == 0) wanted = found;
            const std::string difference = first_difference(wanted, found);
            if (!difference.empty())
                return Error{files[i] + ": " + difference + ", accepted: the same as in " +
                             files[0]};
            const std::string wrong = append(root, files[i], results);
            if (!wrong.empty()) return Error{wrong};
        } catch (const Json::exception& error) {
            return Error{files[i] + ": found no results of this version of `urgengo bench smoke` " +
                         "(" + error.what() + ")"};
        }
    }
    if (results.runs.empty()) return Error{files.at(0) + ": found no run"};
    const std::string wrong = missing_or_twice(results);
    if (!wrong.empty()) return Error{wrong};
    std::sort(results.levels.begin(), results.levels.end());
    results.parameters.emplace_back("merged", std::to_string(texts.size()));
    results.gpu_line = results.runs.front().gpu;
    return results;
}

}  // namespace urgengo::cli
