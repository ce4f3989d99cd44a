// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/bench_conditions.h"

#include <fmt/format.h>

namespace urgengo::cli {

using Json = nlohmann::ordered_json;

Json conditions(const Json& root, const std::set<std::string>& free_parameters) {
    Json all = Json::object();
    for (const char* key : {"program", "gpu", "simulated_gpu", "driver", "version", "commit"})
        all[key] = root.at(key);
    for (const auto& [name, value] : root.at("parameters").items())
        if (!free_parameters.contains(name)) all[name] = value;
    all["workload_hash"] = root.at("workload_hash");
    return all;
}

std::string first_difference(const Json& a, const Json& b) {
    for (const auto& [name, value] : a.items()) {
        const Json other = b.value(name, Json(nullptr));
        if (other != value)
            return fmt::format("{}: found {} and {}", name, value.dump(), other.dump());
    }
    return b.size() != a.size() ? "options that only one of them has" : "";
}

}  // namespace urgengo::cli
