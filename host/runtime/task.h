// SPDX-License-Identifier: Apache-2.0
//
// A chain's tasks as the runtime keeps them: the plan, the slot in the active kernel buffer, and
// the run in progress.
//
// One thread begins a run, its owner. Helper threads may launch for it, too; so `busy` says that
// a thread has taken it: only the thread that has set it touches `run`, `tracker` and the slot. A
// thread that finds it set launches unscheduled, and never waits.
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
#include "host/progress/learning.h"
#include "host/progress/positions.h"
#include "host/runtime/frame_facts.h"
#include "host/runtime/hold_piece.h"
#include "host/runtime/task_copies.h"
#include "host/runtime/task_streams.h"
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

/// Whether a thread has taken a task, and what that thread does when it lets go of it (runs.cpp).
/// Any thread.
struct Taking {
    std::atomic<ThreadState*> owner{nullptr};  ///< has begun the task's run
    std::atomic<bool> busy{false};             ///< some thread is at the task
    std::atomic<bool> end_is_due{false};  ///< the run ended while a helper was busy: it ends it
    std::atomic<bool> sync_end_is_due{false};  ///< the same of a call that waited for all GPU work
    std::atomic<bool> load_parks{false};  ///< no gate is closed while its launch loads a kernel
    std::atomic<bool> streams_are_gone{false};  ///< destroyed while a thread was at the task
    /// Of the hold that a thread is in, with this task, be it of a launch or a copy; null: none
    /// (recovery.cpp, steering.cpp). Written by the thread that has `busy`.
    std::atomic<const void*> held_frame{nullptr};
};

/// Launches that the task's owner makes without asking (planned_launches.h).
struct UnaskedLaunches {
    /// How many of them (TaskSlot::as_planned) are in `run`, `tracker` and `counters`. Written by
    /// the thread that has `busy`, read by any; as is:
    std::atomic<std::uint32_t> counted{0};
    std::atomic<std::uint32_t> from{0};  ///< position in the plan of the first that is not
    std::atomic<std::uint32_t> observed{
        0};  ///< of `counted`, those of runs that were not scheduled
    // The owner's:
    std::uint32_t functions_epoch = 0;  ///< identity::Kernels::epoch() of handles, also the plan's
    model::PlannedKernel last;          ///< of a task without a plan

    std::uint32_t uncounted(const abi::TaskSlot& slot) const {
        // For a thread that has not taken the task, `counted` may be ahead of what was read.
        const std::uint32_t so_far = counted.load(std::memory_order_acquire);
        return slot.as_planned.load(std::memory_order_acquire) - so_far;
    }
};

/// Its launches behind gates (gates.h). The thread that has `busy` only.
struct GatedLaunches {
    bool is_open = true;  ///< none of its gates is closed, as far as its thread knows
    bool is_hold = false;
    bool are_wanted = false;     ///< GateKeeper::are_wanted() as of its first wait in the instance
    std::uint32_t instance = 0;  ///< TaskSlot::instance then
    CUstream stream = nullptr;
    nanoseconds since{0};
    std::uint32_t behind = 0;  ///< launches
    sched::Decision decision;  ///< of the first one
    const exec::DispatchContext* dispatch = nullptr;
    HoldPiece piece;
};

/// What would be held, while UrgenGo only decides (Common::only_decides). Written by the thread
/// that has `busy`, read by any:
struct WouldHold {
    std::atomic<std::uint64_t> launches{0};
    std::atomic<std::int64_t> ns{0};
    nanoseconds since{0};  ///< of the first launch in a row; 0: the last one would have gone

    void begins(nanoseconds now) {
        bump(launches);
        if (since.count() == 0) since = now;
    }
    void ends(nanoseconds now, nanoseconds most) {
        if (since.count() == 0) return;
        bump(ns, std::min(now - since, most).count());
        since = nanoseconds{0};
    }
};

/// How launches are known to be of a task.
struct KnownBy {
    config::Task config;               ///< never changes
    std::atomic<bool> matched{false};  ///< something has ever been of this task
    double confidence = 1;  ///< moving share of instances that went as planned; its owner's
};

/// What is told of it (frame_causes.h, run_records.h, chain_status.h).
struct NotedFacts : TaskFacts {
    int recorded_priority = 0;  ///< of its last launch that was asked about
    WouldHold would_hold;
};

struct MarkedBatches : progress::TaskBatches {
    exec::BatchEvents::Events events;
};

struct TaskState : sched::GovernedTask {
    alignas(64) Taking taking;
    TaskCounters counters;
    UnaskedLaunches unasked;
    // The thread that has `busy` only:
    TrackedRun tracked;
    model::InstanceTracker tracker;
    unsigned long long line_of = 0;  ///< id of the context that `line` is of
    MarkedBatches batches;
    std::unique_ptr<progress::Learning> learning;  ///< null: not asked for
    /// What it launched last, and how fast the GPU gets on with it; read by any thread.
    model::LaunchLog log;
    model::Pace pace;
    TaskStreams streams;
    TaskCopies copies;
    GatedLaunches gates;
    KnownBy known_by;
    NotedFacts facts;

    ChainState& its_chain() const { return static_cast<ChainState&>(*chain); }
    const std::string& name() const { return known_by.config.name; }
    /// @returns UnaskedLaunches::uncounted(), of a run that is scheduled; by any thread, about
    std::uint32_t uncounted_scheduled() const {
        return is_unseen.load(std::memory_order_relaxed) ? 0 : unasked.uncounted(*slot);
    }
    /// @returns its launches that were scheduled without being asked about; by any thread, about
    std::uint32_t num_as_planned() const {
        const std::uint32_t observed = unasked.observed.load(std::memory_order_relaxed);
        const bool is_observed = is_unseen.load(std::memory_order_relaxed);
        const std::uint32_t uncounted = is_observed ? unasked.uncounted(*slot) : 0;
        const std::uint32_t all = slot->as_planned.load(std::memory_order_relaxed);
        // While they are counted, some may be in both.
        const auto scheduled = static_cast<std::int32_t>(all - observed - uncounted);
        return static_cast<std::uint32_t>(std::max(scheduled, 0));
    }
};

/// @returns what marks and logs say of whose instance they are
inline std::uint16_t instance_tag(const abi::TaskSlot& slot) {
    return static_cast<std::uint16_t>(slot.instance.load(std::memory_order_relaxed));
}

// By the thread that has taken the task:

/// Of all launches ever.
inline std::uint64_t num_launched(const TaskState& task) {
    return task.counters.launches.load(std::memory_order_relaxed);
}
/// @returns estimated GPU time of the launches that are still to come in this run
inline nanoseconds still_to_launch(const TaskState& task) {
    return task.learning ? task.learning->durations().remaining_from(task.run.position)
                         : task.plan.remaining_from(task.tracker.position());
}
/// @returns what the GPU will wait for them, alone
inline nanoseconds still_idle(const TaskState& task) {
    return task.learning ? nanoseconds{0} : task.plan.idle_from(task.tracker.position());
}

}  // namespace urgengo::runtime
