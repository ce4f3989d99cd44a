// SPDX-License-Identifier: Apache-2.0
#include "host/config/profile_reader.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "host/config/file_text.h"
#include "host/config/json_cursor.h"
#include "host/config/profile_json.h"

namespace urgengo::config {
namespace {

template <typename Named>
auto find_named(const std::vector<Named>& list, const std::string& name) {
    return std::find_if(list.begin(), list.end(),
                        [&](const Named& element) { return element.name == name; });
}

/// Notes everything in `from` that `in` lacks. Both are lists of chains that have lists of tasks.
template <typename FromChain, typename InChain>
void note_missing(const std::vector<FromChain>& from, const std::vector<InChain>& in,
                  const std::string& complaint, std::vector<std::string>& warnings) {
    for (const FromChain& chain : from) {
        const auto other = find_named(in, chain.name);
        if (other == in.end()) {
            warnings.push_back("chain '" + chain.name + "' " + complaint);
            continue;
        }
        for (const auto& task : chain.tasks) {
            if (find_named(other->tasks, task.name) != other->tasks.end()) continue;
            warnings.push_back("task '" + task.name + "' of chain '" + chain.name + "' " +
                               complaint);
        }
    }
}

}  // namespace

Result<Profile> parse_profile(std::string_view text, const std::string& file) {
    const Result<nlohmann::json> root = parse_json(text, file);
    if (!root) return Error{root.error()};
    JsonFault fault{file, {}};
    Profile profile = profile_from_json(JsonCursor(*root, fault));
    if (!fault.message.empty()) return Error{fault.message};
    return profile;
}

Result<Profile> read_profile(const std::string& path) {
    const Result<std::string> text = read_file(path);
    if (!text) return Error{text.error()};
    return parse_profile(*text, path);
}

std::vector<std::string> profile_warnings(const Config& config, const Profile& profile) {
    std::vector<std::string> warnings;
    note_missing(config.chains, profile.chains, "is not in the profile", warnings);
    note_missing(profile.chains, config.chains, "is in the profile but not in the config",
                 warnings);
    return warnings;
}

}  // namespace urgengo::config
