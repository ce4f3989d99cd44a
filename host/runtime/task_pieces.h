// SPDX-License-Identifier: Apache-2.0
//
// What the GPU did for a task when, as observe/executed_pieces.h tells it: from the points that its
// marks left, its log of launches and its segments. Copies them; made where a frame was late.
//
// @threads any; takes no lock. What is overwritten meanwhile is left out
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "host/observe/executed_pieces.h"
#include "host/runtime/task.h"

namespace urgengo::runtime {

class TaskPieces {
  public:
    /// Of so many marks and launches, and of their part of segments and holds, all are read.
    static constexpr std::uint32_t kAll = model::ExecutedPoints::kRing;
    /// @returns how many may be read of each of so many tasks, so that all of them take no longer
    ///          than some do
    static std::uint32_t share_of(std::size_t num_tasks);
    static std::uint32_t segments_of(std::uint32_t most) { return most / 4; }
    static std::uint32_t holds_of(std::uint32_t most) { return most / 8; }

    /// @param from  begin of the earliest segment that is asked for
    /// @param most  of its marks, the newest, and launches: what lies before them is told as if it
    ///              had had no marks, and all had been launched at once
    TaskPieces(const TaskState& task, nanoseconds from, nanoseconds now, std::uint32_t most = kAll);

    /// @param segment  of the task's windows
    std::vector<observe::ExecutedPiece> of(const GpuWindows::Segment& segment) const;

  private:
    nanoseconds now_;
    nanoseconds next_;                            ///< work up to the next mark
    std::vector<observe::ExecutedPoint> points_;  ///< by work
    std::vector<observe::LaunchedWork> launches_;
};

}  // namespace urgengo::runtime
