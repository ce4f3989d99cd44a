// SPDX-License-Identifier: Apache-2.0
//
// The command line as results record it: what was run, without the folders in which it happened to
// lie on that machine.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace urgengo {

inline std::string command_line_for_results(const std::vector<std::string>& arguments) {
    std::string line;
    for (const std::filesystem::path argument : arguments) {
        if (!line.empty()) line += ' ';
        line += argument.is_absolute() ? argument.filename().string() : argument.string();
    }
    return line;
}

}  // namespace urgengo
