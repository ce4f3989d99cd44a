// SPDX-License-Identifier: Apache-2.0
//
// What differs between the rows of a bench, and how sure that is. Pure.
//
//  1 A row's miss ratio at a load is the mean over its runs of their overall miss ratios.
//  2 Its interval is a bootstrap's, percentiles 2.5 to 97.5: runs (seeds) are drawn with
//    replacement, and in each of them its blocks of one second, so that few runs, too, show how
//    much frames that follow each other share their luck.
//  3 Rows of a seed have the same arrivals: each draw takes the same runs and blocks of all rows,
//    and the difference to the reference, the first row that is not bare, is taken draw by draw.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tools/bench/smoke/bench_results.h"

namespace urgengo::cli {

inline constexpr int kResamples = 2000;

struct Interval {
    double value = 0, low = 0, high = 0;
};

struct Effect {
    std::string row;
    double f_a = 0;
    Interval miss_pct;
    std::optional<Interval> difference;  ///< to the reference; none for itself
};

/// @returns the first row that is not bare; empty: none
std::string reference_row(const BenchResults& results);

/// @returns every row at every load, in their order; nothing if some run does not know its blocks,
///          or not every row has a run of each seed
std::vector<Effect> effects(const BenchResults& results);

}  // namespace urgengo::cli
