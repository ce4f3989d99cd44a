// SPDX-License-Identifier: Apache-2.0
//
// The active kernel buffer (AKB, section 4.4 of the paper) as plain data: one slot a task, atomics
// and offsets only, so that it can lie in memory that several processes share.
//
// Writers: the thread that runs a task's instance writes its slot. Any reader may advance
// marks_done/progress_ns. Readers take no lock; those that need `deadline_ns` and the two `later_*`
// of one and the same instance check `version` before and after (odd: being written).
//
// Times are nanoseconds on CLOCK_MONOTONIC.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

namespace urgengo::abi {

inline constexpr std::uint32_t kSharedPageMagic = 0x55474b42;  // "UGKB"
inline constexpr std::uint32_t kSharedPageVersion = 12;
inline constexpr int kMaxTasks = 256;
inline constexpr int kTaskWords = kMaxTasks / 64;  ///< a bit a task
inline constexpr std::uint32_t kMarkRing = 64;     ///< power of two
inline constexpr std::uint32_t kGateRing = 16;     ///< power of two: closed gates of a task

/// What the thread that runs the task is doing.
///
///   kIdle --task_begin--> kCpu --first launch--> kGpu <--> kHeld
///     ^                    ^                      |
///     +----- task_end -----+---- synchronised ----+
///
/// kSync, from kCpu or kGpu and back: in a call that waits for all work of the context.
enum class TaskState : std::uint32_t { kIdle = 0, kCpu = 1, kGpu = 2, kHeld = 3, kSync = 4 };

/// Whether others' launching slows the task's own (host/model/launch_contention.h).
enum class Launching : std::uint32_t { kUnknown = 0, kSlowed = 1, kFree = 2, kParallel = 3 };

/// Why a launch waits.
enum class Why : std::uint8_t {
    kNone,          ///< it does not
    kRank,          ///< more urgent work fills the GPU
    kRunAhead,      ///< its own work does
    kTurnToLaunch,  ///< enough others launch that it would slow down
    kDrain,         ///< a more urgent task waits for all GPU work
    kThreshold,     ///< another task is truly urgent
    kBucket,        ///< its range of priorities has a request on the GPU
    kGroup,         ///< another group has its turn
    kExclusive,     ///< one task at a time
};

struct alignas(64) TaskSlot {
    // --- the instance: written under `version`, at its begin and at segment boundaries
    std::atomic<std::uint32_t> version;
    std::atomic<TaskState> state;
    std::atomic<std::int64_t> deadline_ns;   ///< t_arr + D
    std::atomic<std::int64_t> later_gpu_ns;  ///< estimated GPU time of the chain's later tasks
    std::atomic<std::int64_t> later_cpu_ns;  ///< estimated CPU time of segments not yet begun
    std::atomic<std::int64_t> cpu_until_ns;  ///< kCpu: when the segment at hand should end
    std::atomic<std::int64_t> period_ns;     ///< of the chain
    std::atomic<std::uint32_t> instance;     ///< counts the task's instances
    std::atomic<std::uint16_t> criticality;  ///< of the chain, raised at its limit of misses
    std::atomic<std::uint16_t> demotes;      ///< 1: an instance that is late gives way to all
    /// The process that writes the slot; 0: none. While it holds a launch, look_ns is its
    /// heartbeat: written every 10 ms at least.
    std::atomic<std::uint32_t> owner;
    std::atomic<std::uint32_t> waits;  ///< 1: its thread is in a call that waits for the GPU

    // --- the launch head: written at every launch
    alignas(64) std::atomic<std::uint32_t> marks_issued;  ///< sequence number of the last mark
    std::atomic<std::uint32_t> head_utilization_ppm;      ///< U_k of the launch at hand
    std::atomic<std::int64_t> head_remaining_ns;          ///< the task's GPU time not yet launched
    std::atomic<std::int64_t> head_idle_ns;   ///< what the GPU will wait for those launches, alone
    std::atomic<std::int64_t> launched_ns;    ///< estimated GPU time of all launches ever
    std::atomic<std::int64_t> launch_ns;      ///< when the last launch was
    std::atomic<std::int64_t> look_ns;        ///< when the thread last asked to launch
    std::atomic<std::int64_t> sync_until_ns;  ///< kSync: when what it waits for should be done
    std::atomic<std::uint16_t> started;       ///< 1: has launched in the GPU segment at hand
    /// How fast its thread launches, in thousandths of how it does alone; 0: as alone. At marks.
    std::atomic<std::uint16_t> launch_speed_pm;
    std::atomic<std::uint32_t> as_planned;  ///< launches ever that went as planned, unasked

    // --- progress: written by the thread that sees it first
    alignas(64) std::atomic<std::uint32_t> marks_done;  ///< last mark seen executed
    std::atomic<std::uint32_t> gates_closed;  ///< the launching thread: its last gate; 0: none ever
    std::atomic<std::int64_t> progress_ns;  ///< when marks_done moved, or the first mark after idle
    /// Until then the less urgent give way to overdue work, to see whether they were what it waits
    /// for: what is on the GPU at a low priority cannot be given a higher one.
    std::atomic<std::int64_t> cleared_until_ns;
    /// Starvation (host/model/starvation.h), of the instance: for how long it has given way to
    /// others, how long that was at its last turn before all others, and when that turn ends.
    std::atomic<std::int64_t> gave_way_ns, turn_at_ns, turn_until_ns;
    /// When what no mark can tell of should have executed, and which mark that is behind: a word of
    /// host/model/unmarked_work.h; 0: marks tell. Written by the launching thread.
    std::atomic<std::int64_t> unmarked_until;
    /// A deadline is lent until so much of launched_ns has executed (host/model/lent_deadline.h);
    /// 0: none was. Written by the lending thread.
    std::atomic<std::int64_t> lent_until_ns;

    /// launched_ns as it was before mark s is at [s % kMarkRing].
    alignas(64) std::atomic<std::int64_t> launched_at_mark_ns[kMarkRing];

    // --- the chain: hardly ever written
    alignas(64) std::atomic<std::int64_t> relative_deadline_ns;  ///< D
    std::atomic<std::int64_t> chain_gpu_ns;  ///< estimated GPU time of an instance of the chain
    std::atomic<std::int64_t> chain_cpu_ns;  ///< the same of its CPU segments
    std::atomic<std::uint32_t> chain;        ///< index of the chain
    std::atomic<std::uint32_t> static_rank;  ///< of the chain: 0 for the tightest deadline
    std::atomic<std::uint32_t> mean_utilization_ppm;  ///< of the task's kernels, by their time
    /// What launched_ns and head_remaining_ns are to be multiplied by (model/estimate_factor.h);
    /// 0: by 1. All other times are multiplied already.
    std::atomic<std::uint32_t> factor_ppm;
    std::atomic<std::uint32_t> is_supported;  ///< 1: its record supports the estimates
    std::atomic<Launching> launching;         ///< whether others' slows its own
    std::atomic<std::int64_t> later_idle_ns;  ///< head_idle_ns of the chain's later tasks
    std::atomic<std::int64_t> chain_idle_ns;  ///< of all of an instance

    // --- what is lent: hardly ever written
    alignas(64) std::atomic<std::int64_t> lent_deadline_ns;
    std::atomic<std::uint32_t> lent_static_rank;
    std::atomic<std::uint16_t> lent_criticality;
    // --- its place in the urgency queue (host/sched/urgency_queue.h): written while it waits
    std::atomic<Why> queue_why;              ///< kNone: it does not stand there
    std::atomic<std::int32_t> queue_behind;  ///< slot: the first of those that it waits for; -1
    std::atomic<std::int64_t> queue_since_ns;
    std::atomic<std::int64_t> queue_key;  ///< the policy's: the smallest goes first

    // --- its gates (host/runtime/gates.h). Written by the launching thread:
    alignas(64)
        std::atomic<std::int64_t> gate_by_ns;  ///< whatever is decided, the next one opens by then
    std::atomic<std::int64_t> run_ahead_ns;    ///< of launched_ns, that may be open beyond progress
    /// Of the group of launches behind gate s, at [s % kGateRing]: launched_ns before it, its GPU
    /// time, the largest utilisation in it.
    std::atomic<std::int64_t> group_begin_ns[kGateRing];
    std::atomic<std::int64_t> group_time_ns[kGateRing];
    std::atomic<std::uint32_t> group_utilization_ppm[kGateRing];
    // Written by whoever opens one, the GPU among them:
    alignas(64) std::atomic<std::uint32_t> gates_opened;  ///< the word that the stream waits for
    std::atomic<std::uint32_t> gates_opened_by_gpu;       ///< how often
    std::atomic<std::int64_t> gate_opened_ns;
};

/// What a round (host/sched/dispatch_round.h) tells of a task, in one word that is always whole:
/// its laxity, and its place in the urgency order.
struct RankedWord {
    static constexpr std::int64_t kRanks = 512;
    static constexpr std::int64_t kMostLaxity_ns = INT64_MAX / kRanks;
    std::int64_t laxity_ns = 0;
    int rank = 0;  ///< the first is 1; 0: no round has found the task active

    constexpr std::int64_t pack() const {
        const std::int64_t laxity = laxity_ns > kMostLaxity_ns    ? kMostLaxity_ns
                                    : laxity_ns < -kMostLaxity_ns ? -kMostLaxity_ns
                                                                  : laxity_ns;
        return laxity * kRanks + rank;
    }
    static constexpr RankedWord of(std::int64_t word) {
        const std::int64_t rank = word & (kRanks - 1);
        return {(word - rank) / kRanks, static_cast<int>(rank)};
    }
};

/// What the GPU reads of the config and of the plans (host/sched/dispatch_round.h), times on
/// CLOCK_MONOTONIC but for the difference of the clocks.
struct DispatchSettings {
    std::atomic<std::uint32_t> policy;  ///< config::Policy
    std::atomic<std::uint32_t> parked;  ///< calls under way before which all gates open
    std::atomic<double> lambda;
    std::atomic<std::int64_t> pack_limit_ppm, share_limit_ppm;
    std::atomic<std::int64_t> share_slack_ns;
    /// %globaltimer less CLOCK_MONOTONIC, low 48 bits; and some time of late on the latter.
    std::atomic<std::uint64_t> gpu_clock_ahead;
    std::atomic<std::int64_t> clock_base_ns;  ///< 0: the GPU's clock is not known
    std::atomic<std::uint32_t> gpu_rounds;    ///< written by the GPU; and how long they took
    std::atomic<std::uint64_t> gpu_round_us;
    /// When a thread of the host last looked after gates: the heartbeat of leases.
    std::atomic<std::int64_t> beat_ns;
    std::atomic<double> urgent_percentile;
    std::atomic<std::int64_t> gpu_ranked_ns;         ///< as of when the GPU's last round decided
    std::atomic<std::int64_t> gpu_urgent_laxity_ns;  ///< TH_urgent, by the GPU; 0: not known yet
    // The standing plan (host/sched/standing_plan.h):
    std::atomic<std::int64_t> plan_slack_ns;
    std::atomic<std::uint64_t> given_up[kTaskWords], late_first[kTaskWords], may_share[kTaskWords];
};

struct SharedPage {
    std::uint32_t magic;
    std::uint32_t version;
    std::uint32_t num_tasks;
    std::uint32_t slot_bytes;           ///< sizeof(TaskSlot): readers of another version step by it
    std::atomic<std::uint32_t> on_gpu;  ///< slots in state kGpu, kHeld or kSync
    std::atomic<std::uint32_t> changes;  ///< counts how often that changed, or what else decides
    /// Bit i: slot i may be other than kIdle. Set before its run begins, cleared after it: so a
    /// decision looks at those that work, not at all that the config has.
    std::atomic<std::uint64_t> active[kTaskWords];
    alignas(64) TaskSlot tasks[kMaxTasks];
    alignas(64) DispatchSettings dispatch;
    /// A RankedWord a task, by the last round that found it active.
    alignas(64) std::atomic<std::int64_t> ranked[kMaxTasks];
};

static_assert(std::atomic<std::int64_t>::is_always_lock_free);
static_assert(offsetof(SharedPage, tasks) == 64, "one line says who is there");
static_assert(offsetof(TaskSlot, waits) == 60, "the first line has room for it");
static_assert(offsetof(TaskSlot, marks_issued) == 64 && offsetof(TaskSlot, marks_done) == 128);

}  // namespace urgengo::abi
