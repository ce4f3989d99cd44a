// SPDX-License-Identifier: Apache-2.0
//
// What the classes of this folder share: the config's chains and tasks, who decides about them, and
// what stands between them and the driver. Each part owns its state, and says who may call it.
#pragma once

#include "host/base/clock.h"
#include "host/base/thread_nice.h"
#include "host/config/resolved_config.h"
#include "host/exec/mark_width.h"
#include "host/exec/program_streams.h"
#include "host/exec/progress_marks.h"
#include "host/identity/kernels.h"
#include "host/observe/nvtx_out.h"
#include "host/observe/status_page.h"
#include "host/runtime/frame_causes.h"
#include "host/runtime/gate_keeper.h"
#include "host/runtime/live_guard.h"
#include "host/runtime/roster.h"
#include "host/runtime/run_records.h"
#include "host/runtime/task_progress.h"
#include "host/runtime/tracing.h"
#include "host/sched/governor.h"

namespace urgengo::runtime {

/// What watches, and tells others.
struct Observers {
    RunRecords records;
    FrameCauses causes;
    observe::NvtxOut nvtx;  ///< what another tool is told
};

struct Common {
    /// @param driver, clock, trace  outlive it
    Common(const config::ResolvedConfig& resolved, const exec::DriverApi& driver, Clock& clock,
           TraceOptions trace, const observe::ShareOptions& share = {},
           const observe::RecordOptions& record = {});

    config::Mode mode() const { return governor.steered().mode(); }
    /// Else the program's threads wait, as in the paper (tracking.cpp).
    bool follows_marks() const {
        return scheduler.progress.tracking == config::Tracking::kProgress;
    }
    /// One behind every launch.
    bool marks_all() const { return scheduler.progress.mark_every == std::chrono::nanoseconds{0}; }
    /// The active kernel buffer, in memory that the GPU can be shown.
    abi::SharedPage& page() { return status.akb(); }
    /// As far as the guard and `urgengo ctl` are concerned.
    bool enforces(const TaskState& task) const {
        return guard.enforces(task.chain->index) && task.chain->may_be_scheduled();
    }
    /// A launch of the task may go on waiting.
    bool may_hold(const TaskState& task) const { return governor.acts() && task.chain->may_act(); }
    /// Nothing of what is decided of the task is done.
    bool only_decides(const TaskState& task) const {
        return governor.steered().only_decides() || task.run.only_decides;
    }

    const bool launches_block;  ///< CUDA_LAUNCH_BLOCKING
    const config::Scheduler scheduler;
    const exec::DriverApi& driver;
    Clock& clock;
    LiveGuard guard;
    observe::StatusPage status;
    Observers observers;
    TaskProgress progress;
    sched::Governor governor;
    const Roster roster;
    exec::ProgramStreams streams;
    exec::ProgressMarks marks;
    exec::MarkWidth mark_width;
    GateKeeper gate_keeper;
    identity::Kernels kernels;
    Tracer tracer;
    ThreadNice nice;  ///< of threads that work on frames
};

}  // namespace urgengo::runtime
