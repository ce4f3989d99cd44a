// SPDX-License-Identifier: Apache-2.0
#include "interposer/run_conditions.h"

#include <sys/utsname.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "host/config/resolved_config.h"

namespace urgengo::interposer {
namespace {

using Json = nlohmann::ordered_json;

/// @returns the program's arguments, with spaces between them
std::string command_line() {
    std::ifstream file("/proc/self/cmdline", std::ios::binary);
    std::string text{std::istreambuf_iterator<char>(file), {}};
    while (!text.empty() && text.back() == '\0') text.pop_back();
    for (char& c : text)
        if (c == '\0') c = ' ';
    return text;
}

std::string machine() {
    utsname name{};
    if (uname(&name) != 0) return "";
    return std::string(name.sysname) + " " + name.release + " " + name.machine + ", " +
           std::to_string(sysconf(_SC_NPROCESSORS_ONLN)) + " cores";
}

}  // namespace

std::string run_conditions(const config::Config& config, const std::string& file) {
    const char* const connections = std::getenv("CUDA_DEVICE_MAX_CONNECTIONS");
    Json told = {{"command", command_line()},
                 {"UrgenGo", URGENGO_VERSION},
                 {"machine", machine()},
                 {"CUDA_DEVICE_MAX_CONNECTIONS", connections ? connections : "not set"},
                 {"config file", file}};
    Json used = Json::parse(config::to_resolved_json(config, nullptr, {}), nullptr, false);
    if (used.contains("config")) told["config"] = std::move(used["config"]);
    return told.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace urgengo::interposer
