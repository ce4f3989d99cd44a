// SPDX-License-Identifier: Apache-2.0
//
// The middle of some numbers and how far they lie around it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace urgengo::discover {

struct Spread {
    std::size_t count = 0;
    double median = 0, low = 0, high = 0;  ///< 50th, 10th and 90th percentile
};

inline Spread spread_of(std::vector<double> values) {
    if (values.empty()) return {};
    std::sort(values.begin(), values.end());
    const auto at = [&](double share) {
        return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1) +
                                               0.5)];
    };
    return {values.size(), at(0.5), at(0.1), at(0.9)};
}

/// @returns the share of the values within `tolerance` (0..1) of their median
inline double regularity(const std::vector<double>& values, double tolerance) {
    if (values.empty()) return 0;
    const double median = spread_of(values).median;
    if (median <= 0) return 0;
    const auto near = std::count_if(values.begin(), values.end(), [&](double value) {
        return std::abs(value - median) <= tolerance * median;
    });
    return static_cast<double>(near) / static_cast<double>(values.size());
}

}  // namespace urgengo::discover
