// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/level_yaml.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>

#include "host/config/config_reader.h"

namespace urgengo::cli {

Result<std::string> scale_level(const std::string& yaml, const std::string& file, double f_a,
                                double f_d) {
    // Only what the reader accepts has the shape that the next lines rely on.
    if (const auto config = config::parse_config(yaml, file); !config) {
        return Error{config.error()};
    }
    YAML::Node root = YAML::Load(yaml);
    for (YAML::Node chain : root["chains"]) {
        YAML::Node period = chain["period_ms"];
        period = fmt::format("{:.6f}", period.as<double>() / f_a);
        YAML::Node deadline = chain["deadline_ms"];
        deadline = fmt::format("{:.6f}", deadline.as<double>() * f_d);
    }
    return YAML::Dump(root) + "\n";
}

Result<std::string> set_keys(const std::string& yaml, const std::string& file,
                             const std::string& section, const std::string& keys) {
    if (const auto config = config::parse_config(yaml, file); !config) {
        return Error{config.error()};
    }
    YAML::Node root = YAML::Load(yaml);
    for (const auto& key : YAML::Load(keys))
        root[section][key.first.as<std::string>()] = key.second;
    const std::string text = YAML::Dump(root) + "\n";
    if (const auto config = config::parse_config(text, file); !config) {
        return Error{config.error()};
    }
    return text;
}

Result<std::chrono::nanoseconds> longest_period(const std::string& path) {
    const auto config = config::read_config(path);
    if (!config) return Error{config.error()};
    std::chrono::nanoseconds longest{0};
    for (const config::Chain& chain : config->chains) longest = std::max(longest, chain.period);
    return longest;
}

}  // namespace urgengo::cli
