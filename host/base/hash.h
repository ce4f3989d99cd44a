// SPDX-License-Identifier: Apache-2.0
//
// FNV-1a, 64 bit: names of kernels, contents of files. Not for anything that an enemy chooses.
#pragma once

#include <cstdint>
#include <string_view>

namespace urgengo {

constexpr std::uint64_t fnv1a64(std::string_view text) {
    std::uint64_t h = 0xcbf29ce484222325u;
    for (char c : text) h = (h ^ static_cast<unsigned char>(c)) * 0x100000001b3u;
    return h;
}

}  // namespace urgengo
