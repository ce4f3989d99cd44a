// SPDX-License-Identifier: Apache-2.0
//
// What a task's slot in the active kernel buffer says of its chain and of the instance at hand: all
// that laxity (Eq. 2 of the paper) and plans need, but for the launch head and progress.
//
// Estimates of GPU and CPU time are sums over the chain's tasks, whose times their owners keep up
// to date.
//
// @threads the one that has the task; at the start, any; sum_from() and sure_lateness():
//          any
#pragma once

#include <cstdint>

#include "host/model/unmarked_work.h"
#include "host/sched/tasks.h"

namespace urgengo::sched {

/// @returns the estimated time of an instance in the tasks of its chain from this stage on
nanoseconds sum_from(const Tasks& tasks, const GovernedChain& chain, std::size_t stage,
                     std::atomic<std::int64_t> EstimatedTimes::*time);

/// At the start: the slot says whose it is, and the task's times are the plan's.
/// @param owner  process
void describe_task(GovernedTask& task, std::uint32_t owner);
/// What an instance of the whole chain takes, as is known now.
void describe_chain(const Tasks& tasks, GovernedTask& task);
/// The tighter the deadline, the sooner; then the shorter the period; then as the config has them.
void rank_chains(const Tasks& tasks);

/// The launch head of an instance with so much still to launch.
/// @param idle  what the GPU waits for those launches, alone
void publish_head(const GovernedTask& task, nanoseconds remaining, nanoseconds idle);
/// An instance begins: with the CPU segment before its first launch.
/// @param remaining, idle  as of publish_head()
void begin_instance(const Tasks& tasks, GovernedTask& task, nanoseconds deadline,
                    nanoseconds remaining, nanoseconds idle, nanoseconds now);
/// It goes on with CPU segment `segment`, which began then.
void begin_segment(const Tasks& tasks, const GovernedTask& task, std::size_t segment,
                   nanoseconds begin);

/// What the task is about. Not while it waits for all GPU work: then its helper threads neither get
/// it out of the call's state nor see it there half.
inline void set_state(const GovernedTask& task, abi::TaskState state) {
    if (!task.run.sync.waits) task.slot->state.store(state, std::memory_order_release);
}

/// A launch was made: the slot says by when work that no mark tells of should have executed.
/// @param unmarked    of the task's instance
/// @param is_vouched  a mark vouches for all that was launched, or none is needed
/// @param is_alone    no other task is on the GPU
void publish_unmarked(const GovernedTask& task, model::UnmarkedWork& unmarked, bool is_vouched,
                      bool is_alone, nanoseconds now);

/// @returns by how much an instance that arrived then and has come to this task would be late, even
///          alone; below 0: it may be in time
nanoseconds sure_lateness(const Tasks& tasks, const GovernedTask& task, nanoseconds arrival,
                          nanoseconds now);

}  // namespace urgengo::sched
