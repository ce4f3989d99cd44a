// SPDX-License-Identifier: Apache-2.0
//
// Overdue work, and when other tasks give way to it.
//
// 1 Overdue work mostly waits for something that is not the GPU; it blocks no task. But it may have
//   been launched at a low priority and be urgent now: then it stays behind all that others launch,
//   for as long as they launch.
// 2 So the less urgent tasks that pass over it give way to it now and then: after 10 ms, then each
//   time that it has waited twice as long, until their work on the GPU is done and the overdue work
//   has had its time; the longer that was of no use, the more seldom. How long their work takes is
//   not known of a kernel without a profile, so the bound is generous: at least a sixteenth of the
//   time that the overdue work has waited.
// 3 Once no other task has work on the GPU, the overdue work has its time once more, and no longer.
#pragma once

#include "host/config/config.h"
#include "host/sched/snapshot.h"
#include "host/sched/tasks.h"

namespace urgengo::sched {

/// Has the less urgent give way to those in the snapshot that are due for it.
/// @returns whether some task has to now: all are asked again
/// @threads any
bool look_after_overdue(const config::Scheduler& scheduler, const Snapshot& snapshot,
                        const Tasks& tasks);

}  // namespace urgengo::sched
