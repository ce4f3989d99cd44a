// SPDX-License-Identifier: Apache-2.0
//
// Cuts every thread's launches into GPU segments: launches of one task, up to a wait for all of
// them (kTraceCovers), with the CPU segment before.
//
//  1 Whose launch: a hint in force on the thread, what the runtime knew, the thread's NVTX ranges
//    from the innermost out, a kernel that begins a task (which then holds on the thread until
//    another begins), the thread's name.
//  2 A segment also ends where the task changes, and where an instance is known to begin or end: at
//    hints, at a task's NVTX range, where the runtime followed a hint from another thread.
//  3 A thread that never waits is cut where it launches nothing for a while.
#pragma once

#include <cstdint>
#include <vector>

#include "tools/trace/task_match.h"
#include "tools/trace/trace_reader.h"

namespace urgengo::trace {

struct Segment {
    int task = kNoTask;
    std::size_t thread = 0;        ///< index in Trace::threads()
    std::size_t first_launch = 0;  ///< index over the thread's launches
    std::size_t num_launches = 0;
    const TraceRecord* first = nullptr;      ///< its first launch
    const TraceRecord* closed_by = nullptr;  ///< the wait; null if nothing waited
    std::int64_t begin_ns = 0;               ///< when the first launch came in
    std::int64_t end_ns = 0;                 ///< when the wait returned, or the last launch came in
    std::int64_t cpu_ns = 0;     ///< CPU time of the thread since the last segment, without waits
    std::int64_t idle_ns = 0;    ///< time off the CPU since then, without waits
    std::int64_t gap_ns = 0;     ///< wall time since then, without waits; the sum of the two above
    bool begins_task = false;    ///< its first launch is one that begins the task
    std::uint64_t instance = 0;  ///< the same for segments of one instance, where that is known

    /// @returns what closed it, as profiles name it: "stream", ..., "none"
    std::string_view closed_by_name() const;
};

/// @returns the segments of every thread, in time order: shape [thread][segment]
std::vector<std::vector<Segment>> find_segments(const Trace& trace, const TaskMatcher& tasks);

}  // namespace urgengo::trace
