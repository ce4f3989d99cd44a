// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace urgengo::trace {

/// @returns the text as a field of a line of CSV (RFC 4180)
inline std::string csv_field(const std::string& text) {
    if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
    std::string result = "\"";
    for (const char c : text) {
        if (c == '"') result += '"';
        result += c;
    }
    return result + '"';
}

}  // namespace urgengo::trace
