// SPDX-License-Identifier: Apache-2.0
//
// What the text and the JSON of `urgengo top` say in the same words.
#pragma once

#include <cstddef>
#include <iterator>
#include <string>

#include "tools/urgengo/page/page_reader.h"

namespace urgengo::cli {

inline double in_ms(nanoseconds time) {
    return 1e-6 * static_cast<double>(time.count());
}

/// @param task  index; -1: none
inline std::string chain_of_task(const PageReading& page, int task) {
    return task < 0 ? "" : page.chains[page.tasks[static_cast<std::size_t>(task)].chain].name;
}

/// @param chain  index; -1: none
inline std::string name_of_chain(const PageReading& page, int chain) {
    return chain < 0 ? "" : page.chains[static_cast<std::size_t>(chain)].name;
}

/// @returns what the guard lets UrgenGo do for a chain
inline const char* guard_word(std::uint32_t guard) {
    constexpr const char* kWords[] = {"enforce", "priorities", "observe"};
    return guard < std::size(kWords) ? kWords[guard] : "unknown";
}

}  // namespace urgengo::cli
