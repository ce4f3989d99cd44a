// SPDX-License-Identifier: Apache-2.0
//
// How fast a task launches and what it takes altogether, from a run without any tool: nothing is
// timed in it, so nothing is slowed down. What its kernels take was learned from another run; the
// two are put together by shape (kernels' names, launches a segment).
//
//  1 Instances that have no other thread's work beside them count, if there are at least three;
//    else all. Contention only lengthens, so of both it is the lower quartile.
//  2 A launch's time is from the first launch of its segment, when the call came in.
//  3 A segment's latency is from its first launch to the end of the wait that closes it; without
//    such a wait it is not known.
#pragma once

#include <cstddef>
#include <vector>

#include "host/config/config.h"
#include "tools/trace/instances.h"

namespace urgengo::trace {

struct Pace {
    std::size_t instances = 0;  ///< of this shape; 0: nothing was learned
    std::size_t alone = 0;      ///< and of those with nothing beside them
};

/// Fills in launch times, latencies and CPU times.
/// @param segments  of every thread of the trace: what may be beside an instance
/// @param task      the instances in this trace
/// @param profile   with kernels and segments
Pace learn_pace(const Trace& trace, const std::vector<std::vector<Segment>>& segments,
                const TaskInstances& task, config::TaskProfile& profile);

}  // namespace urgengo::trace
