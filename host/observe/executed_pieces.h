// SPDX-License-Identifier: Apache-2.0
//
// What the GPU did for a task when, in pieces: from one mark that was seen executed to the next.
//
//  1 Two points say how much of a task's work has executed, and when. What lies between them has
//    executed between their times, whatever else was on the GPU then.
//  2 A kernel executes no earlier than it was launched. So the time in which all that had been
//    launched of the piece would have executed, alone and as planned, is left out: the piece begins
//    that much later than its first point. What is left is the time in which the GPU had something
//    of the task to execute.
//  3 The segment's begin is a point, and so is its end, if it is the end of a wait for all of it.
//    So a segment without marks is one piece.
//  4 Of a segment that is under way the last piece is open: it goes up to now, and what it executes
//    up to the next mark. That is taken to be executing since its begin, as its end has not come.
//  5 Points may come out of order, and those of a ring may be torn or missing: one at which less
//    had executed than at an earlier one tells nothing.
//  6 Pieces may be joined with their neighbours, where there is no time for so many: what is told
//    from them is coarser then, and no time is lost.
//
// Pure: no clock, no thread.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <vector>

namespace urgengo::observe {

using std::chrono::nanoseconds;

/// Of a task's work, as the plan has it (model::LaunchLog): so much had executed.
struct ExecutedPoint {
    nanoseconds time{0};
    nanoseconds work{0};
};

/// A launch, by the part of the task's work that it is.
struct LaunchedWork {
    nanoseconds time{0};  ///< when it was launched
    nanoseconds begin{0}, end{0};
};

/// A GPU segment of a task.
struct WorkSegment {
    nanoseconds begin{0}, end{0};  ///< in time
    nanoseconds first_work{0}, last_work{0};
    enum class End {
        kLeft,      ///< its thread went on: it may be executed, or not
        kExecuted,  ///< all of it was, at its end
        kOpen,      ///< it is under way: its end is now, and its last work that of the next mark
    } how_ends = End::kLeft;
};

struct ExecutedPiece {
    nanoseconds begin{0}, end{0};  ///< it was to be executed, and not all of it had been
    nanoseconds work{0};           ///< that it takes by the plan
    bool is_open = false;          ///< it has not been executed at its end
    nanoseconds idle{0};           ///< between those that it was joined from

    nanoseconds took() const { return end - begin - idle; }
    /// When it was executing, if nothing interrupted it: as late as can be, an open one as early.
    nanoseconds executes_from() const { return is_open ? begin : end - std::min(work, took()); }
    nanoseconds executes_until() const { return is_open ? begin + std::min(work, took()) : end; }
};

/// What was launched meanwhile stood behind a gate, and could not execute before its end.
/// @param launches  in order
void put_behind_gate(std::vector<LaunchedWork>& launches, nanoseconds begin, nanoseconds end);

/// @returns the sum over them
nanoseconds took(const std::vector<ExecutedPiece>& pieces);

/// Joins neighbours, in groups of the same size, until there are no more than `most` (at least 1).
/// @param pieces  in order
void join(std::vector<ExecutedPiece>& pieces, std::size_t most);

/// @param points    of the task, in any order; also of other segments
/// @param launches  of the task, in order; where they are not known, nothing is left out
/// @returns in order, with something of both time and work
std::vector<ExecutedPiece> pieces_of(const WorkSegment& segment, std::vector<ExecutedPoint> points,
                                     const std::vector<LaunchedWork>& launches);

}  // namespace urgengo::observe
