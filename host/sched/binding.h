// SPDX-License-Identifier: Apache-2.0
//
// Binding: at which of the device's stream priorities does a launch go? Levels count from the
// greatest priority, 0, to the least.
#pragma once

#include <algorithm>

#include "host/config/config.h"
#include "host/sched/snapshot.h"

namespace urgengo::sched {

/// @param decision  for kTask: of the task's first kernel, whose level all others get
/// @param bucket    for kStatic: bucket_of() the task
/// @returns the level, below num_levels
///
///  kernel  the rank, every launch anew
///  task    the paper's task-level binding with reservation (section 4.4.3): truly urgent tasks
///          get level 0; the others' ranks are normalised to the levels from 1 on
///  static  PAAM's: the bucket
constexpr int level_of(config::Binding binding, const Decision& decision, int bucket,
                       int num_levels) {
    const int last = num_levels - 1;
    switch (binding) {
        case config::Binding::kNone:
            break;
        case config::Binding::kKernel:
            return decision.rank < last ? decision.rank : last;
        case config::Binding::kTask:
            if (decision.urgent || last == 0) return 0;
            return std::min(
                last, 1 + decision.rank * last / (decision.num_tasks > 1 ? decision.num_tasks : 1));
        case config::Binding::kStatic:
            return bucket < last ? bucket : last;
    }
    return last;
}

/// @param least, greatest  as cuCtxGetStreamPriorityRange answers; greatest <= least
/// @param wanted           priority_levels; 0: all
constexpr int num_levels(int wanted, int least, int greatest) {
    const int all = least - greatest + 1;
    return wanted > 0 && wanted < all ? wanted : all;
}

}  // namespace urgengo::sched
