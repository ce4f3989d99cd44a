// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/bench_program.h"

#include <fstream>
#include <regex>

#include "host/config/file_text.h"

namespace urgengo::cli {

Environment environment_with(const std::string& interposer, const std::string& config,
                             const std::string& mode, const std::string& stats) {
    const Environment own = current_environment();
    ScheduledProgram scheduled;
    scheduled.interposer = interposer;
    scheduled.summary = false;
    const auto real = own.find("URGENGO_REAL_LIBCUDA");
    if (real != own.end()) scheduled.real_libcuda = real->second;
    scheduled.config = config;
    scheduled.mode = mode;
    scheduled.stats = stats;
    return scheduled_environment(bare_environment(own, interposer), scheduled);
}

std::string driver_version() {
    std::ifstream file("/proc/driver/nvidia/version");
    std::string line;
    std::getline(file, line);
    std::smatch match;
    return std::regex_search(line, match, std::regex("[0-9]+\\.[0-9.]+")) ? match.str() : "";
}

Result<nlohmann::ordered_json> read_json(const std::string& path) {
    const auto text = config::read_file(path);
    if (!text) return Error{text.error()};
    auto json = nlohmann::ordered_json::parse(*text, nullptr, /*allow_exceptions=*/false);
    if (!json.is_object()) return Error{path + ": found no JSON object"};
    return json;
}

}  // namespace urgengo::cli
