// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/sim_workload.h"

#include <filesystem>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "host/config/config_reader.h"
#include "host/config/file_text.h"
#include "host/config/profile_reader.h"
#include "tools/chains/files.h"
#include "tools/sim/workloads.h"

namespace urgengo::cli {
namespace {

bool is_yaml(const std::string& path) {
    const std::string extension = std::filesystem::path(path).extension().string();
    return extension == ".yaml" || extension == ".yml";
}

Result<SimWorkload> read_recorded(const std::string& path, const std::string& profile_path) {
    const auto text = config::read_file(path);
    if (!text) return Error{text.error()};
    const auto config = config::parse_config(*text, path);
    if (!config) return Error{config.error()};
    const std::string beside =
        std::filesystem::path(path).replace_extension(".profile.json").string();
    const std::string& used = profile_path.empty() ? beside : profile_path;
    const auto columns = config::read_file(used);
    if (!columns) return Error{columns.error()};
    const auto profile = config::parse_profile(without_columns(*columns), used);
    if (!profile) return Error{profile.error()};
    auto program = sim::recorded(*config, *profile);
    if (!program) return Error{used + ": " + program.error()};
    return SimWorkload{program->workload, *program, *text, path, {}};
}

/// @returns a list of objects; null unless all columns are as long
nlohmann::json rows_of(const nlohmann::json& columns) {
    nlohmann::json rows = nlohmann::json::array();
    for (const auto& [key, column] : columns.items()) {
        if (!column.is_array() || (!rows.empty() && rows.size() != column.size())) return nullptr;
        for (std::size_t i = 0; i < column.size(); ++i) rows[i][key] = column[i];
    }
    return rows;
}

}  // namespace

std::string without_columns(const std::string& profile) {
    auto root = nlohmann::json::parse(profile, nullptr, /*allow_exceptions=*/false);
    if (!root.is_object() || !root.contains("chains")) return profile;
    bool has_columns = false;
    for (auto& chain : root["chains"]) {
        if (!chain.is_object() || !chain.contains("tasks")) continue;
        for (auto& task : chain["tasks"])
            if (task.is_object() && task.contains("kernels") && task["kernels"].is_object()) {
                task["kernels"] = rows_of(task["kernels"]);
                has_columns = true;
            }
    }
    return has_columns ? root.dump() : profile;
}

std::vector<std::string> SimWorkload::names() const {
    std::vector<std::string> list;
    for (const chains::Chain& chain : workload.chains) list.push_back(chain.name);
    return list;
}

SimWorkload SimWorkload::at(double load) const {
    SimWorkload one = *this;
    const auto its = times.find(load);
    if (its == times.end() || !one.recorded) return one;
    sim::set_times(*one.recorded, its->second);
    one.workload = one.recorded->workload;
    return one;
}

Result<SimWorkload> read_sim_workload(const std::string& path, const std::string& profile) {
    if (is_yaml(path)) return read_recorded(path, profile);
    if (!profile.empty())
        return Error{
            "--profile: found no chains.yaml that it is of, accepted: --workload FILE.yaml"};
    if (path.empty()) return SimWorkload{sim::h200_ten_chains(), {}, {}, {}, {}};
    try {
        return SimWorkload{chains::parse_workload(chains::read_file(path)), {}, {}, {}, {}};
    } catch (const std::runtime_error& error) {
        return Error{path + ": " + error.what()};
    }
}

}  // namespace urgengo::cli
