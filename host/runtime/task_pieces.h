// SPDX-License-Identifier: Apache-2.0
//
// What the GPU did for a task when, as observe/executed_pieces.h tells it: from the points that its
// marks left, its log of launches and its segments. Copies them; made where a frame was late.
//
// @threads any; takes no lock. What is overwritten meanwhile is left out
#pragma once

#include <vector>

#include "host/observe/executed_pieces.h"
#include "host/runtime/task.h"

namespace urgengo::runtime {

class TaskPieces {
  public:
    /// @param from  begin of the earliest segment that is asked for
    TaskPieces(const TaskState& task, nanoseconds from, nanoseconds now);

    /// @param segment  of the task's windows
    std::vector<observe::ExecutedPiece> of(const GpuWindows::Segment& segment) const;

  private:
    nanoseconds now_;
    nanoseconds next_;  ///< work up to the next mark
    std::vector<observe::ExecutedPoint> points_;
    std::vector<observe::LaunchedWork> launches_;
};

}  // namespace urgengo::runtime
