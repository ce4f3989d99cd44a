// SPDX-License-Identifier: Apache-2.0
//
// Tasks as host/progress reads them: where the GPU is in their work, and what marks tell of its
// clock and of kernels' times.
#pragma once

#include <optional>
#include <string_view>

#include "host/base/clock.h"
#include "host/observe/nvtx_out.h"
#include "host/progress/positions.h"
#include "host/runtime/roster.h"
#include "host/runtime/run_records.h"
#include "host/sched/governor.h"

namespace urgengo::runtime {

class TaskProgress final : public sched::ProgressListener {
  public:
    /// @param all but `tracking`  outlive it; touched only when it is asked
    TaskProgress(config::Tracking tracking, Clock& clock, const abi::SharedPage& page,
                 sched::Governor& governor, const Roster& roster, RunRecords& records)
        : clock_(clock),
          page_(page),
          governor_(governor),
          roster_(roster),
          records_(records),
          positions_(tracking, sched::kMarkVisible, clock) {}

    /// @param out  outlives it; is told of every mark that has been seen executed
    void show_to(observe::NvtxOut& out) { shown_to_ = &out; }

    /// A mark has been seen executed.
    /// @threads any
    void progressed(sched::GovernedTask& task, const sched::SlotView& view,
                    const ug_mark_line& line, nanoseconds pending) override;

    /// @returns where the GPU is in this task's work; nothing if there is no such task, it never
    ///          launched anything that was scheduled, or what is known changed under every look
    /// @threads any; takes no lock, calls no driver
    std::optional<progress::TaskPosition> position(std::string_view chain, std::string_view task);

    /// %globaltimer of the device whose work is scheduled, on the host's clock.
    const model::GpuClock& gpu_clock() const { return positions_.gpu_clock(); }

    // Of a task whose times are learned, by the thread that has taken it:
    void segment_begins(TaskState& task) { task.learning->segment_begins(others()); }
    /// From its newest mark.
    void learn(TaskState& task);

  private:
    static void note_executed(TaskState& task, const progress::Positions::Seen& seen);
    progress::Learning::Others others() const;

    Clock& clock_;
    const abi::SharedPage& page_;
    sched::Governor& governor_;
    const Roster& roster_;
    RunRecords& records_;
    progress::Positions positions_;
    observe::NvtxOut* shown_to_ = nullptr;
};

}  // namespace urgengo::runtime
