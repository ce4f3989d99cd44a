// SPDX-License-Identifier: Apache-2.0
//
// A task's GPU segment, from its first launch to the wait for all of it, as the Governor and the
// other tasks know it: live and in the simulator alike.
//
// @threads the one that has the task
#pragma once

#include <cstddef>

#include "host/sched/governor.h"

namespace urgengo::sched {

/// What leads to a segment.
struct BeforeSegment {
    std::size_t cpu_segment = 0;  ///< the one before it, and
    nanoseconds cpu_begin{0};     ///< when that began; 0: not known
    nanoseconds arrival{0};       ///< of the instance
    std::size_t position = 0;     ///< in the plan
};

/// The task is about to make the first launch of a segment.
void enter_gpu_segment(Governor& governor, GovernedTask& task, const BeforeSegment& before,
                       nanoseconds now);
/// It ends, and is told to the task's estimates if that is when all of it has executed.
void measure_gpu_segment(Governor& governor, GovernedTask& task, bool is_idle, std::size_t position,
                         nanoseconds now);
/// What the newest mark vouches for is all that the task has launched, and has executed.
void all_executed(GovernedTask& task);

}  // namespace urgengo::sched
