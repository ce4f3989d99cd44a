// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/run_kernels.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tools/trace/clean_text.h"

namespace urgengo::trace {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMostNames = 3, kMostNameBytes = 80;
constexpr int kMostNested = 8;

const Json* find(const Json& object, const char* name) {
    if (!object.is_object()) return nullptr;
    const auto found = object.find(name);
    return found == object.end() || !found->is_array() ? nullptr : &*found;
}

}  // namespace

PlannedKernelNames::PlannedKernelNames(const Run& run) {
    // What is nested deeper takes stack for each level.
    const auto is_flat = [](int depth, Json::parse_event_t, Json&) { return depth <= kMostNested; };
    const Json conditions = Json::parse(run.conditions, is_flat, false);
    if (!conditions.is_object() || !conditions.contains("kernels")) return;
    const Json* const names = find(conditions["kernels"], "names");
    const Json* const launches = find(conditions["kernels"], "launches");
    if (!names || !launches) return;
    for (const Json& name : *names)
        names_.push_back(name.is_string() ? clean_text(name.get_ref<const std::string&>().substr(
                                                0, kMostNameBytes))
                                          : "");
    for (const Json& task : *launches) {
        std::vector<std::size_t>& its = launches_.emplace_back();
        if (!task.is_array()) continue;
        for (const Json& launch : task)
            its.push_back(launch.is_number_unsigned() ? launch.get<std::size_t>() : names_.size());
    }
}

std::string PlannedKernelNames::of(const RunPiece& piece) const {
    if (piece.task >= launches_.size()) return {};
    const std::vector<std::size_t>& its = launches_[piece.task];
    std::vector<std::size_t> seen;
    std::string words;
    for (std::size_t i = piece.first_launch; i < piece.end_launch; ++i) {
        // More launches than planned: it is another frame than that.
        if (i >= its.size() || its[i] >= names_.size() || names_[its[i]].empty()) return {};
        if (std::find(seen.begin(), seen.end(), its[i]) != seen.end()) continue;
        if (seen.size() == kMostNames) return words + ", ...";
        words += (seen.empty() ? "" : ", ") + names_[its[i]];
        seen.push_back(its[i]);
    }
    return words;
}

}  // namespace urgengo::trace
