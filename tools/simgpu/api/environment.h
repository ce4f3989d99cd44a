// SPDX-License-Identifier: Apache-2.0
//
// Reading SIMGPU_* variables. One that is wrong keeps its default and leaves one line that says
// what was found and what is accepted.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace urgengo::simgpu {

struct NumberRange {
    double least;
    double most;
    bool whole;
};

/// @returns the variable's number, or `fallback` if it is unset or refused
double read_number(const char* name, double fallback, NumberRange range,
                   std::vector<std::string>& problems);

/// @returns which of `choices` the variable names, or `fallback` if it is unset or refused
std::size_t read_choice(const char* name, const std::vector<std::string_view>& choices,
                        std::size_t fallback, std::vector<std::string>& problems);

}  // namespace urgengo::simgpu
