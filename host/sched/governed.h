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
#include "host/model/fork_progress.h"
#include "host/model/launch_contention.h"
#include "host/model/slot_view.h"
#include "host/model/task_plan.h"
#include "host/sched/absence.h"
#include "host/sched/awaited_work.h"
#include "host/sched/bandwidth.h"
#include "host/sched/launch_gaps.h"
#include "host/sched/lent_forks.h"
#include "host/sched/snapshot.h"
#include "host/sched/task_thread.h"
#include "urgengo/abi/shared_page.h"

namespace urgengo::sched {

struct GovernedChain {
    // Plans read these of every chain:
    alignas(64) std::atomic<std::int64_t> last_arrival_ns{0};  ///< 0: none yet
    std::vector<int> tasks;                                    ///< indices of its tasks, in order
    std::size_t index = 0;                                     ///< in the config
    config::Chain config;                                      ///< as the program was started with
    /// What a reload has changed of it since; -1: nothing.
    struct Reloaded {
        std::atomic<std::int64_t> period_ns{-1}, deadline_ns{-1};
        std::atomic<int> mode{-1}, on_late{-1}, criticality{-1}, max_consecutive_misses{-1};
    } reloaded;
    /// What it may be at most: so says `urgengo ctl`.
    std::atomic<config::Mode> allowed{config::Mode::kEnforce};
    std::atomic<std::uint64_t> misses_in_a_row{0};  ///< now
    Expectation expectation;
    Bandwidth bandwidth;

    /// Whatever the mode of all chains.
    config::Mode mode() const {
        return std::min(now(reloaded.mode, config.mode), allowed.load(std::memory_order_relaxed));
    }
    nanoseconds period() const { return now(reloaded.period_ns, config.period); }
    nanoseconds deadline() const { return now(reloaded.deadline_ns, config.deadline); }
    config::OnLate on_late() const { return now(reloaded.on_late, config.on_late); }
    int criticality() const { return now(reloaded.criticality, config.criticality); }
    int max_consecutive_misses() const {
        return now(reloaded.max_consecutive_misses, config.max_consecutive_misses);
    }
    bool may_be_scheduled() const {
        return allowed.load(std::memory_order_relaxed) >= config::Mode::kShadow;
    }
    /// What is decided of it may be done.
    bool may_act() const {
        return allowed.load(std::memory_order_relaxed) == config::Mode::kEnforce;
    }
    bool is_switched_off() const {
        return allowed.load(std::memory_order_relaxed) == config::Mode::kOff;
    }
    nanoseconds longest() const { return std::max(period(), deadline()); }
    /// By then a frame has come to its end or never will.
    nanoseconds abandoned_after() const { return 8 * longest(); }

  private:
    template <typename Value, typename Stored>
    static Value now(const std::atomic<Stored>& changed, Value configured) {
        const Stored value = changed.load(std::memory_order_relaxed);
        return value == -1 ? configured : static_cast<Value>(value);
    }
};

/// The instance that a task is working on.
struct GovernedRun {
    /// Not scheduled: by the config, the guard, for lack of confidence, or as it stands aside.
    bool observed = false;
    bool only_decides = false;   ///< what is decided of it is not done: its chain's mode is shadow
    std::uint32_t position = 0;  ///< launches so far
    bool on_gpu = false;         ///< in a GPU segment: counted in SharedPage::on_gpu
    /// Of the last mark:
    struct Mark {
        nanoseconds at{0};      ///< when it was launched, or taken for granted:
        bool tells = false;     ///< at the next launch, whether it has run
        bool was_slow = false;  ///< GovernedTask::is_slow before it
        nanoseconds waited{0};  ///< held + paced then
    } mark;
    /// What its launches have waited, in this instance:
    struct Waited {
        nanoseconds held{0};       ///< for others
        nanoseconds held_idle{0};  ///< of that, with nothing on the GPU
        nanoseconds paced{0};      ///< for its own run-ahead
    } waited;
    /// Of the GPU segment at hand, since its first launch:
    struct SegmentBegin {
        nanoseconds time{0};
        nanoseconds held_idle{0};  ///< Waited::held_idle then
        nanoseconds held{0};       ///< held + paced then
        nanoseconds launched{0};   ///< GovernedTask::launched then
        std::size_t position = 0;  ///< in the plan
        bool alone = false;        ///< no other task was on the GPU
    } segment;
    /// Of its launching, since its speed was told last, or that segment began:
    struct LaunchWindow {
        nanoseconds begin{0};
        nanoseconds waited{0};     ///< held + paced then
        nanoseconds launched{0};   ///< GovernedTask::launched then
        std::size_t position = 0;  ///< in the plan
    } window;
    nanoseconds wait_begin{0};  ///< of the wait that may end it
    /// Of the segments that have ended, for the estimate:
    struct Estimate {
        model::EstimateFactor::Instance measured;
        bool is_measured = true;         ///< each of them by a wait that was seen
        bool beside_bystanders = false;  ///< bystanders launched meanwhile
    } estimate;
    model::LaunchContention::Instance launching;  ///< the same of how long launching them took
    nanoseconds next{0};                          ///< estimated GPU time of the launch at hand
    /// As of the last look of its launches at its own progress:
    struct Pace {
        static constexpr nanoseconds kNoGap = nanoseconds::max();
        nanoseconds looked_at{0};
        /// Since when its thread might have looked again, if that tells a gap (launch_gaps.h, 1).
        nanoseconds gap_since = kNoGap;
        void no_gap() { gap_since = kNoGap; }
        bool is_bounded = true;  ///< else it may run ahead without bound
    } pace;
    /// In a call that waits for all work of the context:
    struct Sync {
        bool waits = false;       ///< its thread is
        bool is_counted = false;  ///< and is counted in SharedPage::on_gpu for that
    } sync;
    struct Priority {
        int level = -1;  ///< to which the task is bound; -1: not bound
        /// Of the context that it launches in, numerically; equal: priorities mean nothing.
        int least = 0, greatest = 0;
    } priority;
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

/// Of an instance, estimated: the profile's, later what was learned. Written by the thread that has
/// the task; read by threads that begin other tasks of the chain.
struct EstimatedTimes {
    std::atomic<std::int64_t> gpu_ns{0};
    std::atomic<std::int64_t> cpu_ns{0};  ///< its CPU segments
    /// What the GPU waits for its launches, at the pace that they usually have.
    std::atomic<std::int64_t> idle_ns{0};
};

/// A task's last launch in a lead (lead.h); read by any thread.
struct LastLead {
    std::atomic<int> level{0};                      ///< 0: what it was of is over
    std::atomic<nanoseconds> from{nanoseconds{0}};  ///< TaskWork::launched before it
    bool is_lent = false;  ///< the launch that goes now is one; for the thread that has the task
};

/// How a task's instances really go, against its plan.
struct TaskRecord {
    Jitter cpu_jitter;    ///< of its CPU segments; read by any thread
    bool learns = false;  ///< its kernels' times are learned from its marks
    // Only for the thread that has the task:
    model::CpuSegments cpu;
    model::EstimateFactor factor;
    model::LaunchContention contention;
    double reckoned_pace = 1;    ///< and which launch times
    double reckoned_factor = 1;  ///< that the plan's idle times were reckoned with
    int given_up_in_a_row = 0;   ///< instances
    /// As of the last time that was known: its program launches more slowly than the GPU executes.
    bool is_slow = false;
    bool overlaps = false;  ///< its kernels depend on each other programmatically
    LentForks lent_forks;
    LaunchGaps gaps;
};

/// Estimated GPU time of all that a task has launched, ever.
struct TaskWork {
    nanoseconds launched{0};
    nanoseconds marked{0};  ///< the same at the last mark
    nanoseconds looked{0};  ///< or look that took a mark's place (MarkSpacing::is_spared)
    int assumed = 0;        ///< marks in a row that were taken for granted

    void marks_all() { marked = looked = launched; }
};

struct GovernedTask {
    // What every thread that decides reads, and is hardly ever written: on a cache line of its own.
    alignas(64) int index = 0;  ///< slot and mailbox line
    /// Others' launching usually makes its own slower (LaunchContention::is_contended).
    std::atomic<bool> is_contended{false};
    /// And they are known to launch in parallel all the same (LaunchContention::is_parallel).
    std::atomic<bool> is_crowded{false};
    GovernedChain* chain = nullptr;
    std::size_t stage = 0;  ///< place in its chain
    abi::TaskSlot* slot = nullptr;
    std::atomic<const ug_mark_line*> line{nullptr};
    EstimatedTimes estimated;
    // Written by all of them:
    /// When the mark after the last one that was seen executed was last seen not to be.
    alignas(64) std::atomic<std::int64_t> pending_ns{0};

    alignas(64) std::atomic<bool> is_unseen{false};  ///< its run makes no marks, so where it is is
                                                     ///< not known
    TaskRecord record;
    LastLead lead;
    AwaitedWork awaited;
    TaskThread thread;
    model::ForkExecuted fork_executed;
    // Only for the thread that has the task:
    std::vector<model::SlotView> views;  ///< scratch of a decision: room for all tasks
    GovernedRun run;
    model::TaskPlan plan;  ///< never changes, but for handles and reach(): they are the owner's
    RememberedDecision decision;
    TaskWork work;
    model::ForkProgress fork;

    /// All that it has launched has executed, or nothing is known of it any more.
    void fork_is_over() {
        fork.is_over();
        fork_executed.forget();
    }

    /// @returns GPU time whose estimates by the plan add up to what `time` really takes
    nanoseconds planned(nanoseconds time) const {
        const double by = record.factor.value();
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
    /// @returns launches that it has not executed, as of the last look. For the thread that has it
    std::uint32_t queued() const {
        const std::uint32_t done = slot->marks_done.load(std::memory_order_relaxed);
        return run.position - run.position_at_mark[done % abi::kMarkRing];
    }
    /// @returns how far ahead of the GPU it is, as of the last look: GPU time, by launched. Of a
    ///          fork, what executed() does not have yet need not be the first that was launched.
    nanoseconds ahead() const {
        const std::uint32_t done = slot->marks_done.load(std::memory_order_relaxed);
        const std::uint32_t issued = slot->marks_issued.load(std::memory_order_relaxed);
        return work.launched - executed() - fork_executed.load(done) - fork.last(issued);
    }
};

static_assert(sizeof(GovernedTask) % 64 == 0, "what is derived begins on a line of its own");
static_assert(offsetof(GovernedTask, pending_ns) == 64 && offsetof(GovernedTask, is_unseen) == 128);

}  // namespace urgengo::sched
