// SPDX-License-Identifier: Apache-2.0
//
// A hash as text: 16 hexadecimal digits, for JSON readers that keep numbers as doubles.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace urgengo::config {

std::string to_hex(std::uint64_t value);

/// @returns nothing for anything but exactly 16 digits
std::optional<std::uint64_t> from_hex(std::string_view text);

}  // namespace urgengo::config
