// SPDX-License-Identifier: Apache-2.0
//
// Launches behind closed gates, as their task's slot tells of them: which launch may wait behind a
// gate, which go behind the last one, and which behind a further one (host/runtime/gates.h says
// why). Who puts the gates into streams is the caller, live and in `urgengo sim`.
//
// @threads the one that has taken the task
#pragma once

#include "host/sched/governor.h"

namespace urgengo::sched {

/// Behind a task's closed gates, at most: behind 1,020 its thread would block in the driver.
inline constexpr std::uint32_t kMostBehindGates = 200;

/// @param is_alone  no other task is on the GPU
/// @returns whether a launch that is to wait may do so behind a gate, as far as the wait says
bool may_stand_behind_gate(const GovernedTask& task, const Wait& wait, bool is_alone);

/// The task's next gate is closed from here on, and the launch at hand begins the group behind it.
/// The mark that tells of it and the gate itself are due.
/// @param run_ahead  RunAhead::bound() of the task
/// @returns the gate's number
std::uint32_t close_next_gate(GovernedTask& task, nanoseconds run_ahead);

/// @param next  estimated GPU time of the launch at hand
/// @param most  of a group
/// @returns whether the launch joins the group behind the last gate
bool joins_group(abi::TaskSlot& slot, nanoseconds next, nanoseconds most);

/// @returns how many gates are closed
std::uint32_t closed_gates(const abi::TaskSlot& slot);
/// @returns whether this gate of the task's is
bool is_gate_closed(const abi::TaskSlot& slot, std::uint32_t gate);

/// All gates are open. @param since  the first of them was closed
/// @returns for how long the task has waited; at least a nanosecond: what is launched from now on
///          was not slow by itself
nanoseconds waited_behind_gates(const abi::TaskSlot& slot, nanoseconds since, nanoseconds now);

}  // namespace urgengo::sched
