// SPDX-License-Identifier: Apache-2.0
//
// A bench's results as text: rows by load, and below it the misses of every chain.
#pragma once

#include <string>

#include "tools/bench/smoke/bench_results.h"

namespace urgengo::cli {

/// @returns "12.3", or "12.3 (11.0..13.1)" if the repeats differ
std::string format_spread(const Spread& spread, int decimals);

/// @param with_chains  every chain's misses, too: a column for each row and load
std::string format_table(const BenchResults& results, bool with_chains = true);

}  // namespace urgengo::cli
