// SPDX-License-Identifier: Apache-2.0
//
// Lending: a launch that would have to wait goes, for the sake of a task that is awaited.
//
// 1 A task that is held goes while a more urgent one does not come, which may be waiting for a lock
//   that the held thread has (absence.h). Asked when a launch would have to wait, and at each look
//   then. It goes behind all others.
// 2 A late or given-up instance comes after all that can be met, and so after all that is awaited.
// 3 A launch that is only paced takes no GPU time from a more urgent task. So it also goes for a
//   less urgent awaited one, and keeps its priority; farther ahead than a lead it has that of a
//   lead, as what comes next must overtake it. It goes a millisecond later than held ones.
//   For a more urgent awaited task it goes behind all others if any task comes before its own; if
//   its own is first, at its own priority, but no farther ahead than a lead (lead.h), or its fork,
//   which is launched as one, as the awaited task will be behind all that went meanwhile. (Behind
//   all others the first task lost its turn to them: under overload, where frames are late that
//   wait for no lock, a chain of criticality 2 missed 37 % instead of 25; simulated.) Farther it
//   goes only as a lead, so that the awaited task overtakes it, and only where that one's thread
//   waits for a mutex that its own thread has.
// 4 Which thread has a mutex of the C library's can be read out of it (base/thread_wait.h). Then a
//   loan is for that thread's task alone, or, if that thread waits for a mutex itself, for the task
//   of the thread that has that one, and so on: what others launched would only be in its way. If
//   that does not help for kByItselfLater, it is for all (the thread may poll for something). It
//   comes at once, from when the frame was due, and needs not have helped before: it is known
//   that the thread has come. (Three chains of 15 ms and one of 150, two share a mutex: 13 % missed
//   when it came after the jitter and a margin, now 6, bare 6.) If the thread that has the mutex
//   waits for the GPU, its task is lent the deadline, as by 6. Simulated GPU:
//   One chain of 26 ms a frame and one of 3 ms share a mutex, a third one has none, load 0.8: they
//   missed 2 of 121 frames, 80 of 400 and none, bare 38, none and none; now 0 to 1 of 200 of the
//   second.
//   An urgent chain and a loose one share a mutex around launches and the wait for them, a third
//   one has none: 13 of 312 urgent frames missed, bare none; now none to 2, the first ones.
// 5 Other ways to hold than the packed admission are as they were published: without loans.
// 6 A task that waits for work of a less urgent one lends it its deadline: that work is launched
//   and cannot be given another priority, so the others have to make room. What that work is behind
//   itself (awaited_work.h) is lent the same deadline, and so on along the row of waits.
//
// @threads any, with the asking task
#pragma once

#include "host/config/config.h"
#include "host/sched/lead.h"
#include "host/sched/tasks.h"

namespace urgengo::sched {

enum class Loan : std::uint8_t {
    kNone,
    kToPaced,  ///< it goes, as its decision says, no farther ahead than a lead
    kToFirst,  ///< the same of one that is first: no farther ahead of the GPU than a lead
    kToLead,   ///< the same farther ahead, at a lead's priority
    kToHeld,   ///< it goes, behind all others
};

/// @param admit  else it is held; then it is only paced
/// @param rank   how many come before it
/// @param reach  of the launch
/// @param is_given_up  by the plan
/// @returns whether the launch, which would have to wait, goes even so
Loan lend_urgency(const config::Scheduler& scheduler, const Tasks& tasks, const GovernedTask& task,
                  bool admit, int rank, Reach reach, bool is_given_up, nanoseconds now);

/// The task waits for work of another one, which becomes as urgent.
/// @param until  GPU time that the other one had launched by then
/// @returns whether it has: then a plan is needed, and all are asked again
bool lend_along(const Tasks& tasks, GovernedTask& task, GovernedTask& waited_for, nanoseconds until,
                nanoseconds now);

}  // namespace urgengo::sched
