// SPDX-License-Identifier: Apache-2.0
//
// How long a task's kernels take, learned from its marks while it runs (`progress: {learn: on}`):
// what lies between two marks that were seen executed goes to model/durations.h. By the thread that
// has the task, whenever it looks at its own progress, marks it, or leaves the GPU.
//
// Only marks with a time of the GPU tell: mark kernels.
#pragma once

#include <cstdint>
#include <optional>

#include "host/model/durations.h"
#include "host/model/gpu_clock.h"
#include "host/model/position.h"
#include "host/model/task_plan.h"

namespace urgengo::progress {

class Learning {
  public:
    /// What else was on the GPU, as of now.
    struct Others {
        std::uint32_t changes = 0;  ///< SharedPage::changes
        bool are_there = false;
    };

    explicit Learning(const model::TaskPlan& plan);

    /// Tasks that were there before do not delay it, if all of its own last segment had executed.
    void segment_begins(const Others& others);
    /// @param idle  all that the task launched is known to have executed
    void segment_ended(bool idle) { left_idle_ = idle; }

    /// @returns the task's newest executed mark, if it was not learned from yet and tells a time
    std::optional<model::ExecutedMark> new_mark(const ug_mark_line& line,
                                                std::uint32_t issued) const;
    /// @param mark      of new_mark(); the clock has seen it
    /// @param overlaps  marks are launched with programmatic stream serialisation
    void learn(const model::ExecutedMark& mark, const model::GpuClock& clock,
               const model::LaunchLog& log, bool overlaps, const Others& others);

    model::Durations& durations() { return durations_; }
    const model::Durations& durations() const { return durations_; }

  private:
    model::Durations durations_;
    model::StampedMark last_;  ///< the newest mark that was learned from
    bool is_known_ = false;    ///< there is one
    bool left_idle_ = true;    ///< all of the last GPU segment is known to have executed
    Others others_;            ///< when the last mark was seen
};

}  // namespace urgengo::progress
