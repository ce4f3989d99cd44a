// SPDX-License-Identifier: Apache-2.0
#include "host/config/kernel_pattern.h"

#include <charconv>

namespace urgengo::config {
namespace {

constexpr char kAny[] = "*";

/// @returns false for anything but a number > 0 or kAny, which is 0
template <typename T>
bool read_count(std::string_view text, T& count) {
    count = 0;
    if (text == kAny) return true;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), count);
    return error == std::errc{} && end == text.data() + text.size() && count > 0;
}

template <typename T>
std::string shown(T count) {
    return count == 0 ? kAny : std::to_string(count);
}

}  // namespace

std::optional<KernelPattern> parse_kernel_pattern(std::string_view text) {
    const std::size_t at = text.rfind('@');
    KernelPattern pattern;
    pattern.name_glob = text.substr(0, at);
    if (pattern.name_glob.empty()) return std::nullopt;
    if (at == std::string_view::npos) return pattern;

    const std::string_view size = text.substr(at + 1);
    const std::size_t cross = size.find('x');
    if (cross == std::string_view::npos) return std::nullopt;
    if (!read_count(size.substr(0, cross), pattern.grid_blocks) ||
        !read_count(size.substr(cross + 1), pattern.block_threads)) {
        return std::nullopt;
    }
    return pattern;
}

std::string to_text(const KernelPattern& pattern) {
    const bool any_size = pattern.grid_blocks == 0 && pattern.block_threads == 0;
    // A size is written even so where the name has an '@' that would be taken for one.
    if (any_size && pattern.name_glob.find('@') == std::string::npos) return pattern.name_glob;
    return pattern.name_glob + "@" + shown(pattern.grid_blocks) + "x" +
           shown(pattern.block_threads);
}

}  // namespace urgengo::config
