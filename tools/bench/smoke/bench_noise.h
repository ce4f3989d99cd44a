// SPDX-License-Identifier: Apache-2.0
//
// A profile made wrong on purpose, to see what wrong estimates cost: the paper's figure on noisy
// estimates, as far as a file can say it.
//
// The paper draws a factor for the execution time of each task instance, uniformly. Here one factor
// for each task of a run, [1 - noise, 1 + noise], multiplies the times of all its kernels: a
// factor for each kernel would cancel out over a task's hundreds. So an estimate is as wrong as in
// the paper, but stays wrong in the same direction for a run, which is harder for a scheduler that
// does not learn; runs of other seeds draw other factors. CPU times stay as they are: they follow
// what is measured anyway.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "host/config/config.h"
#include "tools/bench/smoke/bench_plan.h"

namespace urgengo::cli {

/// Factors depend on the seed and on the order of tasks; those of 100 % are those of 30 %, farther
/// from 1.
void add_noise(config::Profile& profile, unsigned pct, std::uint32_t seed);

/// @errors the source's, or that the file cannot be written
Result<bool> write_noisy_profile(const PlannedNoise& planned);

}  // namespace urgengo::cli
