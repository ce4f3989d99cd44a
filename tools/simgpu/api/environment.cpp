// SPDX-License-Identifier: Apache-2.0
//
// Numbers and choices from the environment.
#include "tools/simgpu/api/environment.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace urgengo::simgpu {

double read_number(const char* name, double fallback, NumberRange range,
                   std::vector<std::string>& problems) {
    const char* text = std::getenv(name);
    if (text == nullptr || *text == '\0') return fallback;
    char* end = nullptr;
    const double value = std::strtod(text, &end);
    const bool valid = *end == '\0' && value >= range.least && value <= range.most &&
                       (!range.whole || value == std::floor(value));
    if (valid) return value;
    problems.push_back(fmt::format("{}: found '{}', accepted: a {} from {} to {}; using {}", name,
                                   text, range.whole ? "whole number" : "number", range.least,
                                   range.most, fallback));
    return fallback;
}

std::size_t read_choice(const char* name, const std::vector<std::string_view>& choices,
                        std::size_t fallback, std::vector<std::string>& problems) {
    const char* text = std::getenv(name);
    if (text == nullptr || *text == '\0') return fallback;
    const auto found = std::find(choices.begin(), choices.end(), text);
    if (found != choices.end()) return static_cast<std::size_t>(found - choices.begin());
    problems.push_back(fmt::format("{}: found '{}', accepted: {}; using {}", name, text,
                                   fmt::join(choices, ", "), choices[fallback]));
    return fallback;
}

}  // namespace urgengo::simgpu
