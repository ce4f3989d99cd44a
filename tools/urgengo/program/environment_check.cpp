// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/program/environment_check.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <string_view>
#include <system_error>

#include "host/base/settings.h"
#include "host/config/names.h"
#include "host/config/nearest_word.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;

constexpr char kPrefix[] = "URGENGO_";

std::vector<std::string> known_variables() {
    std::vector<std::string> names;
    for (const SettingInfo* info = setting_table(); info->name; ++info) names.push_back(info->name);
    return names;
}

/// What host/base/settings.cpp takes for URGENGO_TRACE_KERNELS.
constexpr std::string_view kKernelTimes[] = {"0", "1", "marks", "cupti", "auto"};

template <typename List>
bool contains(const List& list, std::string_view value) {
    return std::find(std::begin(list), std::end(list), value) != std::end(list);
}

/// @returns what is wrong with this variable's value; empty if nothing is
std::string complaint(const std::string& name, const std::string& value) {
    if (value.empty()) return {};
    const auto found = [&](const std::string& accepted) {
        return name + ": found '" + value + "', accepted: " + accepted;
    };
    if (name == "URGENGO_MODE" && !config::from_word<config::Mode>(value)) {
        return found(config::all_words<config::Mode>());
    }
    if (name == "URGENGO_SUMMARY" && value != "0" && value != "1") return found("0, 1");
    if (name == "URGENGO_TRACE_KERNELS" && !contains(kKernelTimes, value))
        return found("0, marks, cupti, auto");
    if (name == "URGENGO_REAL_LIBCUDA" && !fs::exists(value)) {
        return found("the absolute path of a libcuda.so.1");
    }
    if (name == "URGENGO_STATS" || name == "URGENGO_TRACE") {
        const std::string reason = why_not_writable(value);
        if (!reason.empty()) return found("a file that can be written") + " (" + reason + ")";
    }
    return {};
}

}  // namespace

EnvironmentCheck check_environment(const Environment& environment) {
    const std::vector<std::string> known = known_variables();
    EnvironmentCheck check;
    for (const auto& [name, value] : environment) {
        if (!name.starts_with(kPrefix)) continue;
        if (std::find(known.begin(), known.end(), name) == known.end()) {
            const std::string nearest = config::nearest_word(name, known);
            check.warnings.push_back(name + ": nothing reads this variable" +
                                     (nearest.empty() ? "" : " (did you mean '" + nearest + "'?)"));
        }
        if (check.error.empty()) check.error = complaint(name, value);
    }
    return check;
}

std::string why_not_writable(const std::string& path) {
    std::error_code ignored;
    if (fs::is_directory(path, ignored)) return "it is a folder";
    const fs::path parent = fs::path(path).parent_path();
    const std::string folder = parent.empty() ? "." : parent.string();
    // A file is written beside its target and renamed: it is the folder that must be writable.
    if (fs::exists(folder, ignored) && !fs::is_directory(folder, ignored)) {
        return folder + ": Not a directory";
    }
    if (access(folder.c_str(), W_OK | X_OK) == 0) return {};
    return folder + ": " + std::generic_category().message(errno);
}

}  // namespace urgengo::cli
