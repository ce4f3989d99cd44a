// SPDX-License-Identifier: Apache-2.0
//
// Carries out a bench plan: calibrates, writes the configs, learns the profiles, runs every run,
// reads the reports.
#pragma once

#include "host/base/result.h"
#include "tools/bench/smoke/bench_plan.h"
#include "tools/bench/smoke/bench_profile.h"
#include "tools/bench/smoke/bench_results.h"
#include "tools/urgengo/environment.h"

namespace urgengo::cli {

struct BenchOutcome {
    bool interrupted = false;
    std::vector<ProfileSummary> profiles;
    std::vector<RunResult> runs;  ///< complete unless interrupted
};

/// Says on stderr what it is doing.
/// @param environment  for all children; `urgengo run` adds its own to it
/// @errors what failed, with the end of the child's output
Result<BenchOutcome> carry_out(const BenchPlan& plan, const Environment& environment);

}  // namespace urgengo::cli
