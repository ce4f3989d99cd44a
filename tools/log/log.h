// SPDX-License-Identifier: Apache-2.0
//
// What a command-line tool says of its progress and of what went wrong: on stderr, one line each,
// behind the tool's name. What it was asked for it prints on stdout itself. Any thread.
//
// Not for what is loaded into the user's program: that has host/base/log.h.
#pragma once

#include <fmt/format.h>

#include <string_view>
#include <utility>

namespace urgengo::tools {

enum class LogLevel { kDebug, kInfo, kWarning, kError };

/// What this program's lines begin with, from now on; before it is called: "urgengo".
void set_log_name(std::string_view name);

/// Lines below that level are not said, from now on; before it is called: kInfo.
void set_log_level(LogLevel level);

/// @returns whether lines of that level are said
bool says(LogLevel level);

/// What is on the terminal's last line, and goes before a line comes: it is called for that, in the
/// thread that says the line. Null: nothing is.
void set_before_line(void (*erase)());

/// Says one line; a warning says that it is one.
void log_at(LogLevel level, std::string_view text);

template <typename... Args>
void log_debug(fmt::format_string<Args...> format, Args&&... args) {
    log_at(LogLevel::kDebug, fmt::format(format, std::forward<Args>(args)...));
}
template <typename... Args>
void log_info(fmt::format_string<Args...> format, Args&&... args) {
    log_at(LogLevel::kInfo, fmt::format(format, std::forward<Args>(args)...));
}
template <typename... Args>
void log_warning(fmt::format_string<Args...> format, Args&&... args) {
    log_at(LogLevel::kWarning, fmt::format(format, std::forward<Args>(args)...));
}
template <typename... Args>
void log_error(fmt::format_string<Args...> format, Args&&... args) {
    log_at(LogLevel::kError, fmt::format(format, std::forward<Args>(args)...));
}

}  // namespace urgengo::tools
