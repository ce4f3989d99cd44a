// SPDX-License-Identifier: Apache-2.0
//
// A task over several streams in virtual time: what the runtime tells progress::StreamGraph of
// launches, events and waits (host/runtime/streams.cpp), and what it asks it. The graph is the one
// that decides live.
#pragma once

#include "tools/sim/governed_program.h"

namespace urgengo::sim::streams {

/// A run of the task begins.
void begin_run(SimTask& task);
/// Before a launch: it goes to this branch.
void follow(SimTask& task, int branch);
/// The launch has been made.
void launched(SimTask& task);
/// An event is recorded on `other`, and `branch` waits for it.
void joined(SimTask& task, int branch, int other);
/// The thread waits for the branch. @returns whether that is all that the task has launched
bool covers_all(SimTask& task, int branch);
/// And has waited for it.
void waited(SimTask& task, int branch);
/// Whether a mark on the branch of the last launch tells of all that the task has launched.
bool vouches(const SimTask& task, bool follows_marks);

}  // namespace urgengo::sim::streams
