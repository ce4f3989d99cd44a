// SPDX-License-Identifier: Apache-2.0
//
// What the classes of this folder share: the config's chains and tasks, who decides about them, and
// what stands between them and the driver. Each part owns its state, and says who may call it.
#pragma once

#include <memory>

#include "host/base/clock.h"
#include "host/config/resolved_config.h"
#include "host/exec/program_streams.h"
#include "host/exec/progress_marks.h"
#include "host/identity/kernels.h"
#include "host/runtime/gate_keeper.h"
#include "host/runtime/live_guard.h"
#include "host/runtime/roster.h"
#include "host/runtime/task_progress.h"
#include "host/runtime/tracing.h"
#include "host/sched/governor.h"

namespace urgengo::runtime {

/// The active kernel buffer, in memory that the GPU can be shown.
struct UnmapPage {
    void operator()(abi::SharedPage* page) const;
};
using OwnedPage = std::unique_ptr<abi::SharedPage, UnmapPage>;

struct Common {
    /// @param driver, clock, trace  outlive it
    Common(const config::ResolvedConfig& resolved, const exec::DriverApi& driver, Clock& clock,
           TraceOptions trace);

    config::Mode mode() const { return governor.mode(); }
    /// Else the program's threads wait, as in the paper (tracking.cpp).
    bool follows_marks() const { return scheduler.tracking == config::Tracking::kProgress; }
    /// As far as the guard is concerned.
    bool enforces(const TaskState& task) const { return guard.enforces(task.chain->index); }

    const bool launches_block;  ///< CUDA_LAUNCH_BLOCKING
    const config::Scheduler scheduler;
    const bool marks_all;  ///< one behind every launch
    const exec::DriverApi& driver;
    Clock& clock;
    LiveGuard guard;
    const OwnedPage page;
    TaskProgress progress;
    sched::Governor governor;
    const Roster roster;
    exec::ProgramStreams streams;
    exec::ProgressMarks marks;
    GateKeeper gate_keeper;
    identity::Kernels kernels;
    Tracer tracer;
};

}  // namespace urgengo::runtime
