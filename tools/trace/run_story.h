// SPDX-License-Identifier: Apache-2.0
//
// What a run's records tell together: frames with their numbers, and what was done for each: when a
// task worked on it, its GPU segments, waits and holds.
//
//  1 An end tells its begin. A begin without an end is of something that goes on when the recording
//    ends, or that its thread has jumped out of: it is open, until its task's next such thing or
//    its end.
//  2 What is of a task is of the frame with the arrival that its record names; marks name the
//    instance, which the task's begin relates to an arrival.
//  3 A frame whose begin has been overwritten is numbered back from the next one of its chain whose
//    begin is there.
#pragma once

#include <cstdint>
#include <vector>

#include "tools/trace/run_reader.h"

namespace urgengo::trace {

inline constexpr std::size_t kNoFrame = static_cast<std::size_t>(-1);

struct RunFrame {
    std::size_t chain = 0;
    std::uint32_t number = 0;  ///< of the chain's, from 1; 0: not known
    std::int64_t arrival_ns = 0;
    std::int64_t begin_ns = 0;  ///< when it was seen; the arrival, if that was overwritten
    std::int64_t end_ns = 0;    ///< the last that is known of it, if it has not ended
    bool has_ended = false;
    // If it has:
    bool exited = false;
    std::int64_t latency_ns = 0, amount_ns = 0;
    abi::MissCause cause = abi::MissCause::kNone;
    int behind = -1;                 ///< chain
    std::uint16_t cause_detail = 0;  ///< as abi::MissCause says of it

    bool is_late() const { return cause != abi::MissCause::kNone; }
};

struct RunSlice {
    enum class Kind { kTask, kSegment, kWait, kHold };
    Kind kind = Kind::kTask;
    std::size_t task = 0, chain = 0;
    std::size_t frame = kNoFrame;
    std::uint32_t thread = 0;
    std::int64_t begin_ns = 0, end_ns = 0;
    bool is_open = false;
    std::uint8_t flags = 0;          ///< as the record's
    abi::Why why = abi::Why::kNone;  ///< of a hold
    int behind_task = -1, behind_chain = -1;
    std::int64_t estimate_ns = 0;  ///< of a segment

    bool is_paced() const { return (flags & abi::kRunPaced) != 0; }
    std::int64_t length_ns() const { return end_ns - begin_ns; }
};

struct RunStory {
    std::vector<RunFrame> frames;  ///< by chain, then by arrival
    std::vector<RunSlice> slices;  ///< in the order of their begins
    /// kMark, kPriority, kMode, kTrip, kFrameDropped, kCpuUse, kChainMode, kReload, kGuard, kClock,
    /// kPark, kRound; in the order of their times.
    std::vector<RunRecord> points;

    /// @returns the frame's index; kNoFrame: there is none
    std::size_t find(std::size_t chain, std::uint32_t number) const;
};

RunStory tell(const Run& run);

/// @returns "held", "paced", "held at a gate", ...: what a slice is, in words
std::string hold_words(const Run& run, const RunSlice& slice);
/// What one chain is given from a kChainMode or kGuard on.
std::string steered_words(const Run& run, const RunRecord& point);
/// @returns why a launch waited, in a few words
const char* in_words(abi::Why why);
/// @returns the chain's name; "" for -1
std::string chain_name(const Run& run, int chain);
inline double to_ms(std::int64_t ns) {
    return 1e-6 * static_cast<double>(ns);
}
/// @returns "lidar #17"
std::string frame_name(const Run& run, const RunFrame& frame);
/// @returns "camera/detect"
std::string task_name(const Run& run, std::size_t task);

}  // namespace urgengo::trace
