// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/clean_text.h"

#include <cstddef>
#include <cstdint>

namespace urgengo::trace {
namespace {

/// @returns how many bytes the character at the text's begin has; 0: it is none, or is not to be
///          shown
std::size_t length_of_character(std::string_view text) {
    const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
    const std::uint32_t first = byte(0);
    if (first < 0x80) return first >= ' ' && first != 0x7f ? 1 : 0;
    const std::size_t length = first >= 0xf0 ? 4 : first >= 0xe0 ? 3 : 2;
    if (first < 0xc2 || first > 0xf4 || text.size() < length) return 0;
    std::uint32_t character = first & (0x7fu >> length);
    for (std::size_t i = 1; i < length; ++i) {
        if ((byte(i) & 0xc0) != 0x80) return 0;
        character = character << 6 | (byte(i) & 0x3fu);
    }
    // U+0080 to U+009f are control characters, too. Of what is left, each has one way to write it.
    constexpr std::uint32_t kLeast[] = {0xa0, 0x800, 0x10000};
    const bool is_surrogate = character >= 0xd800 && character < 0xe000;
    return character >= kLeast[length - 2] && character <= 0x10ffff && !is_surrogate ? length : 0;
}

}  // namespace

std::string clean_text(std::string_view text) {
    std::string clean;
    while (!text.empty()) {
        const std::size_t length = length_of_character(text);
        if (length == 0)
            clean += '?';
        else
            clean += text.substr(0, length);
        text.remove_prefix(length == 0 ? 1 : length);
    }
    return clean;
}

}  // namespace urgengo::trace
