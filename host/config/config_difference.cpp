// SPDX-License-Identifier: Apache-2.0
//
// By the resolved JSON of both: a key that comes to it later is one that cannot change, until it
// stands here.
#include "host/config/config_difference.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <string_view>

#include "host/config/resolved_config.h"

namespace urgengo::config {
namespace {

using Json = nlohmann::json;

Json to_json(const Config& config) {
    return Json::parse(to_resolved_json(config, nullptr, {})).at("config");
}

/// As the YAML has it.
std::string in_yaml(const std::string& key) {
    constexpr std::string_view kNs = "_ns";
    return key.ends_with(kNs) ? key.substr(0, key.size() - kNs.size()) + "_ms" : key;
}

std::string in_yaml(const std::string& key, const Json& value) {
    if (value.is_null()) return "(none)";
    if (in_yaml(key) != key && value.is_number()) return Json(value.get<double>() / 1e6).dump();
    return value.is_string() ? value.get<std::string>() : value.dump();
}

Json value_of(const Json& object, const std::string& key) {
    const auto found = object.find(key);
    return found == object.end() ? Json() : *found;
}

/// Calls act(key, its value now, its next value) for each that differs.
template <typename Act>
void for_each_other(const Json& now, const Json& next, Act&& act) {
    std::set<std::string> keys;
    for (const Json* object : {&now, &next})
        for (const auto& [key, value] : object->items()) keys.insert(key);
    for (const std::string& key : keys)
        if (const Json a = value_of(now, key), b = value_of(next, key); a != b) act(key, a, b);
}

bool may_change(const std::string& key, const Json& now, const Json& next) {
    constexpr std::string_view kKeys[] = {"period_ns", "deadline_ns", "on_late", "criticality",
                                          "max_consecutive_misses"};
    if (key == "mode") return now != "off" && next != "off";
    return std::find(std::begin(kKeys), std::end(kKeys), key) != std::end(kKeys);
}

void compare_chain(const Json& now, const Json& next, ConfigDifference& found) {
    const std::string chain = "chain '" + now.at("name").get<std::string>() + "': ";
    for_each_other(now, next, [&](const std::string& key, const Json& a, const Json& b) {
        const bool is_told = !a.is_structured() && !b.is_structured();
        (may_change(key, a, b) ? found.changed : found.refused)
            .push_back(chain + in_yaml(key) +
                       (is_told ? " " + in_yaml(key, a) + " -> " + in_yaml(key, b) : ""));
    });
}

std::vector<std::string> names_of(const Json& chains) {
    std::vector<std::string> names;
    for (const Json& chain : chains) names.push_back(chain.at("name"));
    return names;
}

void compare_chains(const Json& now, const Json& next, ConfigDifference& found) {
    const auto names = names_of(now), next_names = names_of(next);
    const auto tell_missing = [&](const auto& from, const auto& in, const char* what) {
        for (const std::string& name : from)
            if (std::find(in.begin(), in.end(), name) == in.end())
                found.refused.push_back("chain '" + name + "' " + what);
    };
    tell_missing(names, next_names, "is gone");
    tell_missing(next_names, names, "is new");
    if (found.refused.empty() && names != next_names)
        found.refused.emplace_back("the chains are in another order");
    if (!found.refused.empty()) return;
    for (std::size_t i = 0; i < names.size(); ++i) compare_chain(now[i], next[i], found);
}

}  // namespace

ConfigDifference difference(const Config& now, const Config& next) {
    ConfigDifference found;
    const Json a = to_json(now), b = to_json(next);
    for_each_other(a, b, [&](const std::string& key, const Json& before, const Json& after) {
        if (key == "chains") return compare_chains(before, after, found);
        if (key == "mode") {
            found.changed.push_back("mode " + in_yaml(key, before) + " -> " + in_yaml(key, after));
        } else if (key == "scheduler") {
            for_each_other(before, after, [&](const std::string& of, const Json& x, const Json& y) {
                if (of == "priority_via" && (y == "auto" || y.is_null())) return;
                found.refused.push_back("scheduler: " + in_yaml(of) + " " + in_yaml(of, x) +
                                        " -> " + in_yaml(of, y));
            });
        } else {
            found.refused.push_back(key + " " + in_yaml(key, before) + " -> " +
                                    in_yaml(key, after));
        }
    });
    return found;
}

std::string joined(const std::vector<std::string>& parts) {
    std::string text;
    for (const std::string& part : parts) text += (text.empty() ? "" : "; ") + part;
    return text;
}

}  // namespace urgengo::config
