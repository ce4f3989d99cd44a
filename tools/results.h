// SPDX-License-Identifier: Apache-2.0
//
// How every program here records a measurement: when, and with which command.
#pragma once

#include <ctime>
#include <filesystem>
#include <string>
#include <vector>

namespace urgengo {

/// What was run, without the folders in which it happened to lie on that machine.
inline std::string command_line_for_results(const std::vector<std::string>& arguments) {
    std::string line;
    for (const std::filesystem::path argument : arguments) {
        if (!line.empty()) line += ' ';
        line += argument.is_absolute() ? argument.filename().string() : argument.string();
    }
    return line;
}

/// Now, as 2026-11-21T09:58:08Z.
inline std::string utc_now() {
    const std::time_t now = std::time(nullptr);
    std::tm utc{};
    gmtime_r(&now, &utc);
    char text[32];
    std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &utc);
    return text;
}

}  // namespace urgengo
