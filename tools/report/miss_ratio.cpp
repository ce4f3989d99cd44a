// SPDX-License-Identifier: Apache-2.0
#include "tools/report/miss_ratio.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace urgengo::report {
namespace {

constexpr double kZ = 1.959963985;  // of the normal distribution, 95 %
constexpr std::size_t kMostBlocks = 20, kLeastInBlock = 5;

double count(const std::vector<bool>& missed, std::size_t begin, std::size_t end) {
    const auto first = missed.begin();
    return static_cast<double>(std::count(first + static_cast<std::ptrdiff_t>(begin),
                                          first + static_cast<std::ptrdiff_t>(end), true));
}

/// @returns by how much the blocks' ratios vary more than independent frames' would; at least 1
double design_effect(const std::vector<bool>& missed, double ratio) {
    const std::size_t blocks = std::min(kMostBlocks, missed.size() / kLeastInBlock);
    if (blocks < 2 || ratio <= 0 || ratio >= 1) return 1;
    double squares = 0;
    for (std::size_t i = 0; i < blocks; ++i) {
        const std::size_t begin = i * missed.size() / blocks;
        const std::size_t end = (i + 1) * missed.size() / blocks;
        const auto size = static_cast<double>(end - begin);
        const double gap = count(missed, begin, end) / size - ratio;
        squares += gap * gap * size;
    }
    const double variance = squares / static_cast<double>(blocks - 1);
    return std::max(1.0, variance / (ratio * (1 - ratio)));
}

}  // namespace

MissRatio miss_ratio(const std::vector<bool>& missed) {
    if (missed.empty()) return {};
    const auto all = static_cast<double>(missed.size());
    const double ratio = count(missed, 0, missed.size()) / all;
    const double n = all / design_effect(missed, ratio);
    const double scale = 1 + kZ * kZ / n;
    const double middle = (ratio + kZ * kZ / (2 * n)) / scale;
    const double half = kZ * std::sqrt(ratio * (1 - ratio) / n + kZ * kZ / (4 * n * n)) / scale;
    return {ratio, std::clamp(middle - half, 0.0, ratio), std::clamp(middle + half, ratio, 1.0)};
}

}  // namespace urgengo::report
