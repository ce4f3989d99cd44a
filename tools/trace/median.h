// SPDX-License-Identifier: Apache-2.0
//
// The middle value of a list.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace urgengo::trace {

/// @param values  not empty
/// @returns the middle one; of an even number of them the lower one, which was really seen
template <typename T>
T median(std::vector<T> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>((values.size() - 1) / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

}  // namespace urgengo::trace
