// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/smoke/bench_program.h"

#include <fstream>
#include <regex>

#include "host/base/atomic_file.h"
#include "host/config/file_text.h"
#include "tools/log/log.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/paths.h"

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

void add_own_time_option(CLI::App& command, std::string& path) {
    command
        .add_option("--own-time-interposer", path,
                    "The library that measures itself [lib/urgengo-own-time/libcuda.so.1 beside "
                    "this program: ninja urgengo_interposer_own_time]")
        ->check(CLI::ExistingFile);
}

Result<bool> find_own_time_library(std::string& path) {
    if (!path.empty()) return true;
    const auto found = own_time_interposer_library();
    if (!found) return Error{found.error()};
    path = *found;
    return true;
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

int end_of_runs(const std::string& error) {
    return error.empty() ? fail(kExitInterrupted, "interrupted") : fail(kExitFailure, error);
}

int write_results(const std::string& path, const std::string& text) {
    if (path.empty()) return 0;
    const auto written = write_file_atomically(path, text);
    if (!written) return fail(kExitFailure, written.error());
    tools::log_info("wrote {}", path);
    return 0;
}

}  // namespace urgengo::cli
