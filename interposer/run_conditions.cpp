// SPDX-License-Identifier: Apache-2.0
#include "interposer/run_conditions.h"

#include <sys/utsname.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "host/config/resolved_config.h"
#include "host/observe/kernel_list.h"

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

// As the status page has them, and no more of them.
Json kernels_of(const config::Config& config, const config::Profile& profile) {
    const observe::KernelList list = observe::list_kernels(config, &profile);
    Json names = Json::array(), launches = Json::array();
    for (const abi::KernelName& name : list.names)
        names.push_back(std::string(name.name, strnlen(name.name, sizeof name.name)));
    for (std::size_t task = 0; task < list.first_launch.size(); ++task) {
        Json& its = launches.emplace_back(Json::array());
        if (list.first_launch[task] == 0) continue;
        // They end where the next task's begin.
        std::size_t end = list.launches.size();
        for (std::size_t next = task + 1; next < list.first_launch.size(); ++next)
            if (list.first_launch[next] != 0) {
                end = list.first_launch[next] - 1;
                break;
            }
        for (std::size_t i = list.first_launch[task] - 1; i < end; ++i)
            its.push_back(list.launches[i].name);
    }
    return {{"names", std::move(names)}, {"launches", std::move(launches)}};
}

}  // namespace

std::string run_conditions(const config::Config& config, const config::Profile* profile,
                           const std::string& file) {
    const char* const connections = std::getenv("CUDA_DEVICE_MAX_CONNECTIONS");
    Json told = {{"command", command_line()},
                 {"UrgenGo", URGENGO_VERSION},
                 {"machine", machine()},
                 {"CUDA_DEVICE_MAX_CONNECTIONS", connections ? connections : "not set"},
                 {"config file", file}};
    Json used = Json::parse(config::to_resolved_json(config, nullptr, {}), nullptr, false);
    if (used.contains("config")) told["config"] = std::move(used["config"]);
    if (profile) told["kernels"] = kernels_of(config, *profile);
    return told.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace urgengo::interposer
