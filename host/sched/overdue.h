// SPDX-License-Identifier: Apache-2.0
//
// Overdue work, and its way.
//
// 1 Overdue work mostly waits for something that is not the GPU; it blocks nobody. But it may have
//   been launched at a low priority and be urgent now: then it is behind all that others launch,
//   for as long as they do.
// 2 So who passes over it lets it have the GPU now and then: after 10 ms, then each time that it
//   has waited for twice as long, until what the others have there is done and it has had its time;
//   the more seldom, the longer it was of no use. How long the others' takes is not known of a
//   kernel without a profile, so the bound is generous: a sixteenth of the time that it has waited,
//   at least.
// 3 That nobody else has anything there any more is seen: from then on it has its time, once more,
//   and no longer.
#pragma once

#include "host/config/config.h"
#include "host/sched/snapshot.h"
#include "host/sched/tasks.h"

namespace urgengo::sched {

/// Has the less urgent give way to those in the snapshot that are due for it.
/// @returns whether somebody has to now: all are asked again
/// @threads any
bool look_after_overdue(const config::Scheduler& scheduler, const Snapshot& snapshot,
                        const Tasks& tasks);

}  // namespace urgengo::sched
