// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/compare/paired_blocks.h"

#include <algorithm>
#include <cmath>
#include <random>

namespace urgengo::cli {
namespace {

/// Up to here all subsets are looked at: 8191.
constexpr std::size_t kAllSubsetsOf = 13;
constexpr std::size_t kRandomSubsets = 9999;

/// @param in  one bit a pair, not all 0
double mean_of(std::span<const double> differences, const std::vector<bool>& in) {
    double sum = 0;
    std::size_t count = 0;
    for (std::size_t i = 0; i < differences.size(); ++i)
        if (in[i]) sum += differences[i], ++count;
    return sum / static_cast<double>(count);
}

/// @returns sorted
std::vector<double> means_of_subsets(std::span<const double> differences, std::uint64_t seed) {
    const std::size_t n = differences.size();
    std::vector<double> means;
    std::vector<bool> in(n);
    if (n <= kAllSubsetsOf) {
        for (std::size_t subset = 1; subset < std::size_t{1} << n; ++subset) {
            for (std::size_t i = 0; i < n; ++i) in[i] = (subset >> i & 1) != 0;
            means.push_back(mean_of(differences, in));
        }
    } else {
        std::mt19937_64 random(seed);
        while (means.size() < kRandomSubsets) {
            std::uint64_t bits = 0;
            for (std::size_t i = 0; i < n; ++i) {
                if (i % 64 == 0) bits = random();
                in[i] = (bits >> i % 64 & 1) != 0;
            }
            if (std::find(in.begin(), in.end(), true) != in.end())
                means.push_back(mean_of(differences, in));
        }
    }
    std::sort(means.begin(), means.end());
    return means;
}

}  // namespace

std::optional<Difference> difference(std::span<const BlockPair> pairs, double confidence,
                                     std::uint64_t seed) {
    Difference result;
    result.pairs = pairs.size();
    std::vector<double> differences;
    for (const BlockPair& pair : pairs) {
        result.a += pair.a;
        result.b += pair.b;
        differences.push_back(pair.b - pair.a);
    }
    if (pairs.empty()) return std::nullopt;
    result.a /= static_cast<double>(pairs.size());
    result.b /= static_cast<double>(pairs.size());

    const std::vector<double> means = means_of_subsets(differences, seed);
    const auto gaps = static_cast<double>(means.size() + 1);
    constexpr double kRounding = 1e-9;
    const auto k = static_cast<std::size_t>((1 - confidence) / 2 * gaps + kRounding);
    if (k == 0) return std::nullopt;
    result.low = means[k - 1];
    result.high = means[means.size() - k];
    // Means that are 0 speak against a difference, on both sides.
    const auto not_above = std::upper_bound(means.begin(), means.end(), 0.0) - means.begin();
    const auto not_below = means.end() - std::lower_bound(means.begin(), means.end(), 0.0);
    const auto against = static_cast<double>(std::min(not_above, not_below) + 1);
    result.p = result.adjusted_p = std::min(1.0, 2 * against / gaps);
    return result;
}

void adjust(std::span<Difference* const> together) {
    std::vector<Difference*> sorted(together.begin(), together.end());
    std::sort(sorted.begin(), sorted.end(),
              [](const Difference* x, const Difference* y) { return x->p < y->p; });
    double least = 0;
    for (std::size_t i = 0; i < sorted.size(); ++i) {
        const auto times = static_cast<double>(sorted.size() - i);
        least = std::max(least, std::min(1.0, times * sorted[i]->p));
        sorted[i]->adjusted_p = least;
    }
}

}  // namespace urgengo::cli
