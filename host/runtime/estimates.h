// SPDX-License-Identifier: Apache-2.0
//
// What sched/estimates.h is told of a task, and what the guard and the statistics are told of it.
//
// @threads the one that has taken the task
#pragma once

#include "host/runtime/calls.h"
#include "host/runtime/common.h"

namespace urgengo::runtime {

/// The instance has ended.
void instance_measured(Common& common, TaskState& task);
/// Into its chain's statistics.
void note_launching(const TaskState& task);
/// Into its slot: what the task has not launched yet.
void publish_head(TaskState& task);

/// @returns the time that stands for a kernel that the plan does not know, and how much of the
/// GPU's
///          threads it takes
model::KernelEstimate unknown_kernel(const TaskState& task, const Launch& launch);

}  // namespace urgengo::runtime
