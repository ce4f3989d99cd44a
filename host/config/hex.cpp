// SPDX-License-Identifier: Apache-2.0
#include "host/config/hex.h"

#include <charconv>

namespace urgengo::config {
namespace {

constexpr std::size_t kDigits = 16;

}  // namespace

std::string to_hex(std::uint64_t value) {
    char digits[kDigits];
    const auto end = std::to_chars(digits, digits + kDigits, value, 16).ptr;
    const auto length = static_cast<std::size_t>(end - digits);
    return std::string(kDigits - length, '0') + std::string(digits, length);
}

std::optional<std::uint64_t> from_hex(std::string_view text) {
    std::uint64_t value = 0;
    const char* const end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, value, 16);
    if (error != std::errc{} || stop != end || text.size() != kDigits) return std::nullopt;
    return value;
}

}  // namespace urgengo::config
