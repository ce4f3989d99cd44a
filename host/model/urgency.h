// SPDX-License-Identifier: Apache-2.0
//
// Laxity and urgency of a task chain's instance, Eq. 2 of the paper:
//
//     UL(t) = 1 / (t_arr + D - sum of remaining GPU time - sum of remaining CPU time - t)
//
// The denominator is the laxity: how long the instance could do nothing and still be in time. We
// compute and compare laxities, in integer nanoseconds, so that every place that decides agrees to
// the bit; urgency itself is only for people.
#pragma once

#include <chrono>

namespace urgengo::model {

using std::chrono::nanoseconds;

/// What remains of an instance.
struct Remaining {
    nanoseconds deadline{0};  ///< t_arr + D, on the clock of `now`
    nanoseconds gpu{0};       ///< alone: GPU work, and what the GPU waits for launches
    nanoseconds cpu{0};
};

/// @returns slack to the deadline; negative once the deadline can no longer be met
/// @source  paper Eq. 2
constexpr nanoseconds laxity(const Remaining& r, nanoseconds now) {
    return r.deadline - r.gpu - r.cpu - now;
}

/// @returns urgency in 1/s: larger is sooner, negative past the point of no return
inline double urgency_per_s(nanoseconds lax) {
    return lax.count() == 0 ? 1e9 : 1e9 / static_cast<double>(lax.count());
}

}  // namespace urgengo::model
