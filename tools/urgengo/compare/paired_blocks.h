// SPDX-License-Identifier: Apache-2.0
//
// Is b better than a? Of blocks that came in pairs, one of each, in random order. Pure.
//
// Frames of a block are alike (they meet the same load, and their phases drift slowly), so frames
// are not counted as if each told something by itself: a block gives one number, and a pair one
// difference. What drifts more slowly than a pair is the same in both. What is left of it changes
// sign with the order, which was drawn at random: so if there is no difference, each pair's is as
// likely to be d as -d, whatever the other pairs' are. That is all that is assumed. It needs
// neither independent frames nor a normal distribution, and holds for miss ratios that are mostly
// zero.
//
// From it follows (Hartigan 1969, typical values): the true difference is as likely to lie between
// any two neighbours of the means of all subsets of the pairs. So the interval is from the k-th
// smallest of these means to the k-th largest; with many pairs, of random subsets.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace urgengo::cli {

/// With fewer pairs than these, 95 % cannot be had.
inline constexpr std::size_t kLeastPairs = 6;

/// One pair's numbers.
struct BlockPair {
    double a = 0, b = 0;
};

struct Difference {
    std::size_t pairs = 0;
    double a = 0, b = 0;       ///< means over the pairs
    double low = 0, high = 0;  ///< of b - a, with the confidence asked for
    double p = 1;              ///< so often it would be as far from 0 if there were none
    double adjusted_p = 1;     ///< among all that are told together (adjust)

    double mean() const { return b - a; }
};

/// @param confidence  0..1
/// @param seed        of the subsets, where not all of them are looked at
/// @returns nothing if there are too few pairs for an interval
std::optional<Difference> difference(std::span<const BlockPair> pairs, double confidence,
                                     std::uint64_t seed);

/// Who looks at twenty differences finds one beyond 95 % where there is none. After this, the
/// smallest adjusted_p of all of them is below 5 % in one of twenty comparisons without a
/// difference (Holm 1979).
void adjust(std::span<Difference* const> together);

}  // namespace urgengo::cli
