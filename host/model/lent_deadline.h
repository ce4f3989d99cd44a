// SPDX-License-Identifier: Apache-2.0
//
// A deadline that is lent: a task whose work another one waits for.
//
//   1 A stream, or a thread, of a task waits for an event behind work of another task. Until that
//     work has executed, the other one is as urgent as the task that waits: it takes over its
//     deadline, if that is earlier, with its criticality and place in the static order.
//   2 Only that work is due by then. What remains of a task by a lent deadline is what it has
//     launched up to the event.
//   3 A waiting task that has been lent a deadline lends that deadline, and one that is lent one
//     later lends it on (sched/lending.h): so a row of waits is as urgent as the task at its end.
//   4 A deadline that cannot be met any more is not lent to a task whose own can be: it would rank
//     behind all.
//
// Several may lend at a time: the earliest deadline holds until the last event. A race between them
// costs a loan, or has one last as long as the other.
//
// @threads any
#pragma once

#include <algorithm>
#include <optional>

#include "host/model/slot_view.h"
#include "urgengo/abi/shared_page.h"

namespace urgengo::model {

struct LentDeadline {
    nanoseconds deadline{0};
    nanoseconds until{0};  ///< the slot's launched GPU time, of all launches before the event
    int criticality = 1;
    int static_rank = 0;
};

/// @param executed  GPU time of the slot's launches that is known to have executed
/// @returns what is lent to the task; nothing if it has come to the end of that
std::optional<LentDeadline> lent_deadline(const abi::TaskSlot& slot, nanoseconds executed);

/// @returns whether that changed anything
bool lend_deadline(abi::TaskSlot& slot, const LentDeadline& loan, nanoseconds executed);

}  // namespace urgengo::model
