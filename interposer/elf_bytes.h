// SPDX-License-Identifier: Apache-2.0
//
// Reading structures and names out of the bytes of an ELF file that may be anything: what lies
// outside of them is not there.
#pragma once

#include <cstdint>
#include <cstring>
#include <optional>
#include <string_view>

namespace urgengo::interposer {

/// @returns the T at `offset`; nothing if it does not lie within the bytes
template <typename T>
std::optional<T> read_elf(std::string_view bytes, std::uint64_t offset) {
    if (offset > bytes.size() || bytes.size() - offset < sizeof(T)) return {};
    T value;
    std::memcpy(&value, bytes.data() + offset, sizeof value);
    return value;
}

/// @returns the text up to its zero byte; empty if it has none
inline std::string_view elf_text_at(std::string_view bytes, std::uint64_t offset) {
    if (offset >= bytes.size()) return {};
    const std::size_t end = bytes.find('\0', offset);
    return end == std::string_view::npos ? std::string_view{} : bytes.substr(offset, end - offset);
}

}  // namespace urgengo::interposer
