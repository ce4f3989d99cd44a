// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/environment.h"

#include <unistd.h>

#include <filesystem>
#include <string_view>

namespace urgengo::cli {
namespace {

const char kPreload[] = "LD_PRELOAD";
const char kLibraryPath[] = "LD_LIBRARY_PATH";
const char kNvtxTool[] = "NVTX_INJECTION64_PATH";
const char kToolBehind[] = "URGENGO_NVTX_TOOL";
const char kConnections[] = "CUDA_DEVICE_MAX_CONNECTIONS";

/// The entries of `list`, separated by any of `separators`, without empty ones and without `entry`.
std::string without(std::string_view list, std::string_view separators, std::string_view entry) {
    std::string kept;
    while (!list.empty()) {
        const std::size_t end = std::min(list.find_first_of(separators), list.size());
        const std::string_view item = list.substr(0, end);
        list.remove_prefix(std::min(end + 1, list.size()));
        if (item.empty() || item == entry) continue;
        if (!kept.empty()) kept += ':';
        kept += item;
    }
    return kept;
}

void prepend(std::string& list, std::string_view separators, const std::string& entry) {
    const std::string rest = without(list, separators, entry);
    list = entry;
    if (!rest.empty()) list.append(":").append(rest);
}

/// Ours is the one tool that NVTX knows; it loads the one that was there.
void become_nvtx_tool(Environment& environment, const std::string& ours) {
    std::string& tool = environment[kNvtxTool];
    if (!tool.empty() && tool != ours) environment[kToolBehind] = tool;
    tool = ours;
}

void set_unless_empty(Environment& environment, const char* name, const std::string& value) {
    if (!value.empty()) environment[name] = value;
}

}  // namespace

Environment current_environment() {
    Environment environment;
    for (char** line = environ; line && *line; ++line) {
        const std::string_view text = *line;
        const std::size_t equals = text.find('=');
        if (equals == std::string_view::npos) continue;
        // The first of two equal names is the one that getenv finds.
        environment.emplace(text.substr(0, equals), text.substr(equals + 1));
    }
    return environment;
}

std::vector<std::string> to_lines(const Environment& environment) {
    std::vector<std::string> lines;
    lines.reserve(environment.size());
    for (const auto& [name, value] : environment) lines.push_back(name + "=" + value);
    return lines;
}

void prepend_library_folder(Environment& environment, const std::string& folder) {
    // An empty entry means the current folder; it is dropped, for it is nearly always a mistake.
    prepend(environment[kLibraryPath], ":;", folder);
}

Environment scheduled_environment(Environment environment, const ScheduledProgram& program) {
    prepend(environment[kPreload], ": ", program.interposer);
    prepend_library_folder(environment,
                           std::filesystem::path(program.interposer).parent_path().string());
    set_unless_empty(environment, "URGENGO_CONFIG", program.config);
    set_unless_empty(environment, "URGENGO_MODE", program.mode);
    set_unless_empty(environment, "URGENGO_STATS", program.stats);
    set_unless_empty(environment, "URGENGO_RUN_TRACE", program.trace);
    set_unless_empty(environment, "URGENGO_REAL_LIBCUDA", program.real_libcuda);
    environment["URGENGO_SUMMARY"] = program.summary ? '1' : '0';
    if (program.nvtx) become_nvtx_tool(environment, program.interposer);
    if (program.connections > 0) {
        environment.emplace(kConnections, std::to_string(program.connections));
    }
    return environment;
}

Environment bare_environment(Environment environment, const std::string& interposer) {
    const auto tool = environment.find(kNvtxTool);
    if (tool != environment.end() && tool->second == interposer) {
        const auto behind = environment.find(kToolBehind);
        if (behind == environment.end())
            environment.erase(tool);
        else
            tool->second = behind->second;
    }
    std::erase_if(environment,
                  [](const auto& entry) { return entry.first.starts_with("URGENGO_"); });
    const auto preload = environment.find(kPreload);
    if (preload == environment.end()) return environment;
    preload->second = without(preload->second, ": ", interposer);
    if (preload->second.empty()) environment.erase(preload);
    return environment;
}

}  // namespace urgengo::cli
