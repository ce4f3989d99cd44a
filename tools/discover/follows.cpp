// SPDX-License-Identifier: Apache-2.0
#include "tools/discover/follows.h"

#include <algorithm>
#include <cmath>

namespace urgengo::discover {
namespace {

/// The second begins within this share of the period after the first's end...
constexpr double kSoon = 0.1;
/// ... in so many of its frames.
constexpr double kNearlyAlways = 0.9;
constexpr double kSamePeriod = 0.05;

/// @returns the gaps from the last end of `first` before each begin of `second`
std::vector<double> gaps(const Activity& first, const Activity& second) {
    std::vector<double> ends;
    for (const trace::Instance& frame : first.frames) {
        ends.push_back(static_cast<double>(frame.segments.back().end_ns));
    }
    std::sort(ends.begin(), ends.end());
    std::vector<double> result;
    for (const trace::Instance& frame : second.frames) {
        const auto begin = static_cast<double>(frame.begin_ns);
        const auto after = std::upper_bound(ends.begin(), ends.end(), begin);
        result.push_back(after == ends.begin() ? INFINITY : begin - *(after - 1));
    }
    return result;
}

bool is_soon_after(const std::vector<double>& gaps, double period_ns) {
    const auto soon = std::count_if(gaps.begin(), gaps.end(),
                                    [&](double gap) { return gap <= kSoon * period_ns; });
    return static_cast<double>(soon) >= kNearlyAlways * static_cast<double>(gaps.size());
}

/// Runs back to back: it is always soon after everything.
bool never_pauses(const Activity& activity) {
    std::vector<double> busy;
    for (const trace::Instance& frame : activity.frames) {
        busy.push_back(static_cast<double>(frame.segments.back().end_ns - frame.begin_ns));
    }
    return spread_of(busy).median > (1 - kSoon) * activity.period_ns.median;
}

}  // namespace

std::vector<Follows> find_follows(const Activities& activities) {
    std::vector<Follows> found;
    for (std::size_t a = 0; a < activities.list.size(); ++a) {
        for (std::size_t b = 0; b < activities.list.size(); ++b) {
            const Activity& first = activities.list[a];
            const Activity& second = activities.list[b];
            const double period = first.period_ns.median;
            const bool same_rate =
                std::abs(second.period_ns.median - period) <= kSamePeriod * period;
            if (a == b || !same_rate || never_pauses(first) || never_pauses(second)) continue;
            const std::vector<double> after = gaps(first, second);
            if (is_soon_after(after, period)) found.push_back({a, b, spread_of(after).median});
        }
    }
    return found;
}

}  // namespace urgengo::discover
