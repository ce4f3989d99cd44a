// SPDX-License-Identifier: Apache-2.0
//
// What decisions know of a task, of its instance, and of a chain, besides the slots in the active
// kernel buffer. Plain data: the runtime derives its records, with what it tracks of launches and
// the GPU, from these (runtime/task.h); the decisions of this folder never see the rest.
//
// One thread at a time is at a task, and writes its record. What other threads read is atomic, or
// never changes once the record is known to them.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "host/config/config.h"
#include "host/model/cpu_segments.h"
#include "host/model/estimate_factor.h"
#include "host/model/launch_contention.h"
#include "host/model/slot_view.h"
#include "host/model/task_plan.h"
#include "host/sched/absence.h"
#include "host/sched/bandwidth.h"
#include "host/sched/snapshot.h"
#include "urgengo/abi/shared_page.h"

namespace urgengo::sched {

struct GovernedChain {
    // Plans read these of every chain:
    alignas(64) std::atomic<std::int64_t> last_arrival_ns{0};  ///< 0: none yet
    std::vector<int> tasks;                                    ///< indices of its tasks, in order
    std::size_t index = 0;                                     ///< in the config
    config::Chain config;
    std::atomic<std::uint64_t> misses_in_a_row{0};  ///< now
    Expectation expectation;
    Bandwidth bandwidth;

    nanoseconds longest() const { return std::max(config.period, config.deadline); }
    /// By then a frame has come to its end or never will.
    nanoseconds abandoned_after() const { return 8 * longest(); }
};

/// The instance that a task is working on.
struct GovernedRun {
    bool observed = false;  ///< not scheduled: by the config, the guard, or for lack of confidence
    std::uint32_t position = 0;     ///< launches so far
    bool on_gpu = false;            ///< in a GPU segment: counted in SharedPage::on_gpu
    nanoseconds marked_at{0};       ///< when the last mark was launched, or taken for granted:
    bool mark_tells = false;        ///< at the next launch, whether it has run
    bool was_slow = false;          ///< GovernedTask::is_slow before the last mark
    nanoseconds waited_at_mark{0};  ///< held + paced then
    nanoseconds held{0};            ///< waited for others, in this instance
    nanoseconds held_idle{0};       ///< of that, with nothing on the GPU
    nanoseconds paced{0};           ///< waited for its own run-ahead, in this instance
    /// Of the GPU segment at hand, since its first launch:
    struct SegmentBegin {
        nanoseconds time{0};
        nanoseconds held_idle{0};  ///< GovernedRun::held_idle then
        nanoseconds held{0};       ///< held + paced then
        nanoseconds launched{0};   ///< GovernedTask::launched then
        std::size_t position = 0;  ///< in the plan
        bool alone = false;        ///< no other task was on the GPU
    } segment;
    nanoseconds wait_begin{0};                    ///< of the wait that may end it
    model::EstimateFactor::Instance measured;     ///< in the segments that have ended
    bool is_measured = true;                      ///< each of them by a wait that was seen
    bool beside_bystanders = false;               ///< bystanders launched meanwhile
    model::LaunchContention::Instance launching;  ///< the same of how long launching them took
    nanoseconds next{0};                          ///< estimated GPU time of the launch at hand
    nanoseconds looked_at{0};   ///< when its own progress was last looked at by its launches
    bool is_paced = true;       ///< as of the last look: else it may run ahead without bound
    bool in_sync = false;       ///< its thread waits for all work of the context
    bool sync_counted = false;  ///< and is counted in SharedPage::on_gpu for that
    int level = -1;             ///< of priority, to which the task is bound; -1: not bound
    /// Of the context that it launches in, numerically; equal: priorities mean nothing.
    int least_priority = 0, greatest_priority = 0;
    /// Launches before mark s: at [s % kMarkRing].
    std::array<std::uint32_t, abi::kMarkRing> position_at_mark{};
};

/// The last decision that let a launch go.
struct RememberedDecision {
    std::uint32_t changes = 0;  ///< SharedPage::changes when it was made
    nanoseconds time{-1'000'000'000};
    Decision decision;
    double utilization = 0;  ///< of the launch that it was about
};

struct GovernedTask {
    // What every thread that decides reads, and is hardly ever written: on a cache line of its own.
    alignas(64) int index = 0;  ///< slot and mailbox line
    GovernedChain* chain = nullptr;
    std::size_t stage = 0;  ///< place in its chain
    abi::TaskSlot* slot = nullptr;
    std::atomic<const ug_mark_line*> line{nullptr};
    /// Estimated GPU time of an instance: the profile's, later what was learned. Written by the
    /// thread that has the task; read by threads that begin other tasks of the chain.
    std::atomic<std::int64_t> gpu_time_ns{0};
    std::atomic<std::int64_t> cpu_time_ns{0};   ///< the same of its CPU segments
    std::atomic<std::int64_t> idle_time_ns{0};  ///< what the GPU waits for its launches, alone
    // Written by all of them:
    /// When the mark after the last one that was seen executed was last seen not to be.
    alignas(64) std::atomic<std::int64_t> pending_ns{0};

    alignas(64) std::atomic<bool> is_unseen{false};  ///< its run makes no marks, so where it is is
                                                     ///< not known
    bool learns = false;  ///< its kernels' times are learned from its marks
    Jitter cpu_jitter;    ///< of its CPU segments; read by any thread
    // Of the last launch in a lead (lead.h); read by any thread:
    std::atomic<int> lead_level{0};                     ///< 0: what it was of is over
    std::atomic<nanoseconds> led_from{nanoseconds{0}};  ///< `launched` before it
    // Only for the thread that has the task:
    std::vector<model::SlotView> views;  ///< scratch of a decision: room for all tasks
    GovernedRun run;
    model::TaskPlan plan;  ///< never changes, but for handles and reach(): they are the owner's
    model::CpuSegments cpu;
    model::EstimateFactor factor;
    model::LaunchContention contention;
    double reckoned_pace = 1;    ///< and which launch times
    double reckoned_factor = 1;  ///< that the plan's idle times were reckoned with
    int given_up_in_a_row = 0;   ///< instances
    RememberedDecision decision;
    nanoseconds launched{0};  ///< estimated GPU time of all launches ever
    nanoseconds marked{0};    ///< the same at the last mark
    /// As of the last time that was known: its program launches more slowly than the GPU executes.
    bool is_slow = false;
    int assumed = 0;        ///< marks in a row that were taken for granted
    bool overlaps = false;  ///< its kernels depend on each other programmatically

    /// @returns GPU time whose estimates by the plan add up to what `time` really takes
    nanoseconds planned(nanoseconds time) const {
        const double by = factor.value();
        if (by == 1) return time;
        const double planned_ns = static_cast<double>(time.count()) / by;
        return nanoseconds(std::max<std::int64_t>(1, static_cast<std::int64_t>(planned_ns)));
    }
    /// @returns GPU time, by launched, of what has executed as of the last look
    nanoseconds executed() const {
        const std::uint32_t done = slot->marks_done.load(std::memory_order_relaxed);
        return nanoseconds(
            slot->launched_at_mark_ns[done % abi::kMarkRing].load(std::memory_order_relaxed));
    }
};

static_assert(sizeof(GovernedTask) % 64 == 0, "what is derived begins on a line of its own");
static_assert(offsetof(GovernedTask, pending_ns) == 64 && offsetof(GovernedTask, is_unseen) == 128);

}  // namespace urgengo::sched
