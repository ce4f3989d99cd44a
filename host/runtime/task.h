// SPDX-License-Identifier: Apache-2.0
//
// A chain's tasks as the runtime keeps them: the plan, the slot in the active kernel buffer, and
// the run in progress.
//
// One thread begins a run, its owner. Helper threads may launch for it, too; so `busy` says who is
// at it: only the thread that has set it touches `run`, `tracker` and the slot. Whoever finds it
// set launches unscheduled, and never waits.
#pragma once

#include <array>
#include <atomic>
#include <memory>
#include <string>

#include "host/config/config.h"
#include "host/exec/batch_events.h"
#include "host/exec/progress_marks.h"
#include "host/identity/chain.h"
#include "host/model/instance_tracker.h"
#include "host/model/launch_log.h"
#include "host/model/pace.h"
#include "host/model/unmarked_work.h"
#include "host/observe/statistics.h"
#include "host/progress/closing_rule.h"
#include "host/progress/learning.h"
#include "host/progress/positions.h"
#include "host/progress/stream_graph.h"
#include "host/runtime/task_copies.h"
#include "host/sched/governed.h"
#include "urgengo/abi/shared_page.h"

namespace urgengo::runtime {

using std::chrono::nanoseconds;

using identity::ChainState;
using identity::Instance;
using observe::bump;
using observe::TaskCounters;
using progress::kUnknownKernel;

struct ThreadState;

/// Of the instance that a task is working on, what decisions do not know.
struct TrackedRun {
    nanoseconds arrival{0};
    nanoseconds begin{0};
    bool hinted = false;
    nanoseconds cpu_begin{0};    ///< of the CPU segment at hand; 0: none, or not seen
    bool marks_refused = false;  ///< without progress nothing more of this run is scheduled
    CUstream stream = nullptr;   ///< of the last launch; it may be gone since
    exec::StreamFlavor flavor = exec::StreamFlavor::kLegacy;
    int stream_priority = 0;  ///< that stream's own
    bool moved = false;       ///< the launch at hand is on another stream than the last one
    model::UnmarkedWork unmarked;
    const exec::MarkContext* marks = nullptr;
};

struct TaskState : sched::GovernedTask {
    alignas(64) std::atomic<ThreadState*> owner{nullptr};
    std::atomic<bool> busy{false};
    ChainState& its_chain() const { return static_cast<ChainState&>(*chain); }
    std::atomic<bool> end_is_due{false};  ///< the run ended while a helper was busy: it ends it
    std::atomic<bool> sync_end_is_due{false};  ///< the same of a call that waited for all GPU work
    /// TaskState::graph.is_forked(), for those who have not taken the task; and ever.
    std::atomic<bool> is_forked{false}, was_forked{false};
    std::atomic<bool> lost_streams{false};      ///< ever used more at a time than are followed
    std::atomic<bool> streams_are_gone{false};  ///< destroyed while somebody was at the task
    std::atomic<bool> matched{false};           ///< something has ever been of this task
    TaskCounters counters;
    /// How many of the launches that its owner made as planned (TaskSlot::as_planned) are in `run`,
    /// `tracker` and `counters`.
    std::atomic<std::uint32_t> as_planned_counted{0};
    /// Position in the plan of the first of those that are not.
    std::atomic<std::uint32_t> planned_from{0};
    std::uint32_t uncounted() const {
        // Of who has not taken the task, the counted ones may be ahead of what was read.
        const std::uint32_t counted = as_planned_counted.load(std::memory_order_acquire);
        return slot->as_planned.load(std::memory_order_acquire) - counted;
    }
    model::PlannedKernel last_launch;   ///< of a task without a plan that went unasked; the owner's
    std::uint32_t functions_epoch = 0;  ///< identity::Kernels::epoch() of the handles in both
    // Whoever has `busy` only:
    TrackedRun tracked;
    model::InstanceTracker tracker;
    double confidence = 1;  ///< moving share of instances that went as planned
    /// Of the hold that a thread is in, with this task; null: none (runtime/recovery.cpp).
    const void* held_frame = nullptr;
    unsigned long long line_of = 0;  ///< id of the context that `line` is of
    progress::TaskBatches batches;
    exec::BatchEvents::Events batch_events;
    std::unique_ptr<progress::Learning> learning;  ///< null: not asked for
    /// What it launched last, and how fast the GPU gets on with it; read by any thread.
    model::LaunchLog log;
    model::Pace pace;
    /// Its launches over streams, counted by TaskCounters::launches; whoever has `busy`.
    progress::StreamGraph graph;
    progress::ClosingRule closing;
    std::uint64_t launches_at_begin = 0;  ///< when the last run began
    TaskCopies copies;
    std::string name;
    config::Task match;  ///< how launches are known to be of this task
};

/// @returns what marks and logs say of whose instance they are
inline std::uint16_t instance_tag(const abi::TaskSlot& slot) {
    return static_cast<std::uint16_t>(slot.instance.load(std::memory_order_relaxed));
}

}  // namespace urgengo::runtime
