// SPDX-License-Identifier: Apache-2.0
//
// What `urgengo bench overhead` found, and what it says of it. Pure.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "tools/bench/smoke/bench_results.h"

namespace urgengo::cli {

/// The paper's chains at which the goal is, and the goal: half of the paper's 34 us.
inline constexpr int kOverheadGoalChains = 20;
inline constexpr double kOverheadGoalUs = 17;

/// Of one run: means over its instances, but for the median. Microseconds of an instance.
struct OverheadRun {
    double instances = 0;
    double launches = 0;   ///< of an instance
    double decisions = 0;  ///< of an instance; other launches need none
    double deciding_median_us = 0, deciding_us = 0;
    double added_us = 0;       ///< all of our own time but holds: the above is in it, and the next
    double our_driver_us = 0;  ///< in driver calls of ours: marks, queries
    double held_us = 0;
    double polling_us = 0;  ///< in the holds: looks that found that the launch must wait on

    double deciding_ns_a_launch() const { return 1e3 * deciding_us / launches; }
    double added_ns_a_launch() const { return 1e3 * added_us / launches; }
};

/// @param own_time  what the measuring library wrote
/// @errors what it lacks
Result<OverheadRun> parse_own_time(const nlohmann::ordered_json& own_time);

struct OverheadPoint {
    int chains = 1;
    std::vector<OverheadRun> rounds;  ///< not empty

    Spread of(double OverheadRun::*value) const;
};

/// Of the medians over rounds.
struct OverheadFit {
    double us_at_none = 0, us_a_chain = 0;  ///< least squares
    double r_squared = 0;                   ///< 1: they are on that line
    double exponent = 0;  ///< of chains, in a power law: above 1 is worse than linear
};

/// @param points  two or more, of different numbers of chains, above 0 us
OverheadFit fit(const std::vector<OverheadPoint>& points, double OverheadRun::*value);

std::string format_overhead(const std::vector<OverheadPoint>& points);
nlohmann::ordered_json overhead_json(const std::vector<OverheadPoint>& points);

}  // namespace urgengo::cli
