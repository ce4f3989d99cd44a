// SPDX-License-Identifier: Apache-2.0
//
// The commands of urgengo-bench, also for what tells of them without it: completion and man pages.
#pragma once

#include "tools/urgengo/commands.h"

namespace urgengo::cli {

inline constexpr char kBenchDescription[] = "Measures misses and costs, bare and under UrgenGo.";

void add_bench_commands(Commands& commands);

}  // namespace urgengo::cli
