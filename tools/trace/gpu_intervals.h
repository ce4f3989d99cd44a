// SPDX-License-Identifier: Apache-2.0
//
// When each launch of a trace was on the GPU.
//
//  1 Marks behind launches say when each ended. Most say no begin: such a launch began when the one
//    before it on its stream ended. What the mark itself takes (TraceHeader::mark_ns) is taken off,
//    and the GPU's pause between a kernel and the mark behind it (TraceHeader::pause_ns).
//  2 Streams are in order, so launches are chained per stream in the order of their ends, whichever
//    threads made them.
//  3 Between launches that depend on each other programmatically, in a capture, or between a
//    program's timing events there is no mark. Such launches and the next marked one share one
//    interval, in equal parts; `shared` says how many they are, since each part is only a guess.
//    Pauses among them stay in it: those that overlap have none.
//  4 A begin mark that may have executed before its kernel came (kTraceLoose) makes the interval
//    too long. What was measured of marks is only taken off where it is plausible, and of the pause
//    no more than leaves a kernel that can be.
//
// GPU times here are nanoseconds since the first mark of the trace: %globaltimer without its epoch,
// unwrapped. They are not comparable with times of the CPU.
#pragma once

#include <cstdint>
#include <vector>

#include "tools/trace/trace_reader.h"

namespace urgengo::trace {

struct Span {
    std::int64_t begin_ns = 0;
    std::int64_t end_ns = 0;
};

struct GpuInterval {
    const TraceRecord* launch = nullptr;  ///< null: of a launch that was not seen
    bool known = false;                   ///< else nothing below is
    std::int64_t begin_ns = 0;
    std::int64_t end_ns = 0;
    std::uint32_t shared = 1;  ///< launches that the interval was cut into equal parts for
    bool loose = false;        ///< the length may hold some of launching: it is no less than true
    /// A graph's kernels, by their begins, where they are known one by one; else empty.
    std::vector<Span> parts{};

    std::int64_t length_ns() const { return end_ns - begin_ns; }
};

/// What is no kernel's between two marks; 0 where what was measured cannot be true.
struct MarkTimes {
    std::int64_t mark_ns = 0;   ///< a mark's own
    std::int64_t pause_ns = 0;  ///< between a kernel and the mark behind it
};

MarkTimes plausible_mark_times(const abi::TraceHeader& header);

/// @returns the share of the GPU that a launch occupies, 0..1; a graph may fill it
double utilization_of(const TraceRecord& launch);

/// @returns an interval for every launch of every thread: shape [thread][launch], both in the
///          trace's order
std::vector<std::vector<GpuInterval>> gpu_intervals(const Trace& trace);

}  // namespace urgengo::trace
