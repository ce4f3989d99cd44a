// SPDX-License-Identifier: Apache-2.0
//
// A round of the GPU's dispatcher (host/sched/dispatch_round.h, which the host runs as well, to the
// bit): a block of one warp reads the active tasks, ranks them by CUB's merge sort, sums what comes
// before each by CUB's prefix sum, opens the gates of those that may go, and tells laxities and
// ranks. Then the highest urgency is recorded, for TH_urgent.
//
// The GPU's own memory says whether a gate is closed, and which marks have executed; all else is
// read from the host's: a round takes 14 us with ten tasks, 23 with 64, 85 with 256 (H200; 35 us
// with ten beside their work).
#pragma once

#include <cstdint>
#include <cub/block/block_merge_sort.cuh>
#include <cub/block/block_scan.cuh>
#include <cuda/atomic>

#include "host/sched/dispatch_round.h"
#include "host/sched/urgent_steps.h"
#include "urgengo/abi/dispatcher.h"

namespace {

using namespace urgengo;
using abi::DispatchArgs;
using abi::DispatchState;
using sched::Before;
using sched::Entrant;
using std::chrono::nanoseconds;

__device__ std::uint64_t globaltimer_ns() {
    std::uint64_t time_ns;
    asm volatile("mov.u64 %0, %globaltimer;" : "=l"(time_ns));
    return time_ns;
}

template <typename T>
__device__ cuda::atomic_ref<T, cuda::thread_scope_device> in_device(T& value) {
    return cuda::atomic_ref<T, cuda::thread_scope_device>(value);
}
template <typename T>
__device__ cuda::atomic_ref<T, cuda::thread_scope_system> in_system(T& value) {
    return cuda::atomic_ref<T, cuda::thread_scope_system>(value);
}
/// Of what the host declares as std::atomic.
template <typename T>
__device__ void store_shared(std::atomic<T>& value, T desired, cuda::memory_order order) {
    in_system(*reinterpret_cast<T*>(&value)).store(desired, order);
}

__device__ bool is_in(const std::atomic<std::uint64_t>* words, int task) {
    return (load_shared(words[task / 64]) >> (task % 64) & 1) != 0;
}

__device__ bool knows_time(const DispatchArgs& args) {
    return load_shared(args.page->dispatch.clock_base_ns) != 0;
}

/// Whether the task's stream stands before a closed gate, as far as the GPU's memory knows.
__device__ bool is_closed(DispatchState& state, std::uint32_t task) {
    return in_device(state.reached[task]).load(cuda::memory_order_relaxed) !=
           in_device(state.opened[task]).load(cuda::memory_order_relaxed);
}

/// Whether one does.
__device__ bool any_closed(const DispatchArgs& args, std::uint32_t num_threads) {
    bool closed = false;
    for (std::uint32_t i = threadIdx.x; i < args.num_tasks; i += num_threads)
        closed |= is_closed(*args.state, i);
    return __syncthreads_or(closed) != 0;
}

/// Whether a gate is closed that a stream may stand before sooner or later.
template <int kThreads>
__device__ bool any_to_come(const DispatchArgs& args) {
    bool closed = false;
    for (std::uint32_t i = threadIdx.x; i < args.num_tasks; i += kThreads)
        closed |= load_shared(args.page->tasks[i].gates_closed) !=
                  load_shared(args.page->tasks[i].gates_opened);
    return __syncthreads_or(closed) != 0;
}

__device__ Entrant read_entrant(const DispatchArgs& args, int task,
                                const sched::RoundSettings& settings, nanoseconds now) {
    abi::TaskSlot& slot = args.page->tasks[task];
    const abi::DispatchSettings& page = args.page->dispatch;
    const std::uint32_t version = load_shared(slot.version);
    model::TaskReading reading = model::load_slot(slot);
    const std::uint32_t issued = load_shared(slot.marks_issued);
    std::uint32_t done = load_shared(slot.marks_done);
    const std::int64_t gate_by_ns = load_shared(slot.gate_by_ns);
    const std::int64_t run_ahead_ns = load_shared(slot.run_ahead_ns);
    const sched::GateGroup head = sched::load_group(slot, reading.gates.opened + 1);
    const sched::Standing standing{now, settings.lambda, is_in(page.given_up, task),
                                   is_in(page.late_first, task)};
    const bool may_share = is_in(page.may_share, task);
    DispatchState& state = *args.state;
    if (in_device(state.marked[task]).load(cuda::memory_order_relaxed) != 0) {
        const std::uint32_t own = in_device(state.done[task]).load(cuda::memory_order_relaxed);
        if (model::is_later_mark(own, done)) {
            done = own;
            reading.last.progress_ns = now.count();  // the host has yet to see it
        }
    }
    model::load_marks(reading, slot, issued, done);
    // A slot that changes hands is of an instance that has just begun or ended. Asked for before
    // anything is computed: the answer takes a trip over the bus.
    const bool is_whole = version % 2 == 0 && load_shared(slot.version) == version;
    Entrant entrant = sched::entrant_of(reading, task, settings, standing, may_share, head,
                                        gate_by_ns, run_ahead_ns);
    if (reading.state == abi::TaskState::kIdle || !is_whole) entrant.contender.blocks = false;
    return entrant;
}

/// What a round begins with, and what comes of it.
struct RoundCommon {
    std::uint64_t active[abi::kTaskWords];
    sched::RoundSettings settings;
    int num_needing_all;
    unsigned long long least_laxity_ns;  ///< of urgent_laxity()
};

/// What the threads of a round share besides, of so many tasks at most.
template <int kThreads, int kItems>
struct RoundMemory {
    static constexpr int kMost = kThreads * kItems;
    struct Ranked {
        sched::Key key;
        std::int32_t task;
        std::int32_t at;
    };
    using Sort = cub::BlockMergeSort<Ranked, kThreads, kItems>;
    using Scan = cub::BlockScan<Before, kThreads>;
    union {
        typename Sort::TempStorage sort;
        typename Scan::TempStorage scan;
    };
    Entrant entrants[kMost];
};

/// @returns the task at this place among the active ones; -1: there are no more
__device__ int nth_active(const std::uint64_t* words, int n) {
    for (int word = 0; word < abi::kTaskWords; ++word) {
        std::uint64_t bits = words[word];
        const int here = __popcll(bits);
        if (n >= here) {
            n -= here;
            continue;
        }
        for (; n > 0; --n) bits &= bits - 1;
        return 64 * word + __ffsll(static_cast<long long>(bits)) - 1;
    }
    return -1;
}

__device__ void open(const DispatchArgs& args, int task, std::uint32_t gate, nanoseconds now) {
    abi::TaskSlot& slot = args.page->tasks[task];
    store_shared(slot.gate_opened_ns, static_cast<std::int64_t>(now.count()),
                 cuda::memory_order_relaxed);
    store_shared(slot.gates_opened, gate, cuda::memory_order_release);
    const std::uint32_t times =
        in_device(args.state->opens[task]).fetch_add(1, cuda::memory_order_relaxed) + 1;
    store_shared(slot.gates_opened_by_gpu, times, cuda::memory_order_relaxed);
}

/// All threads of the block.
template <int kThreads>
__device__ void begin_round(const DispatchArgs& args, RoundCommon& common) {
    if (threadIdx.x < abi::kTaskWords)
        common.active[threadIdx.x] = load_shared(args.page->active[threadIdx.x]);
    if (threadIdx.x == kThreads - 1) {
        common.settings = sched::load_settings(args.page->dispatch);
        common.num_needing_all = 0;
        common.least_laxity_ns = sched::kNoLaxity;
    }
    __syncthreads();
}

/// All threads of the block. Ranks what is active, opens what may go, and tells of it.
template <int kThreads, int kItems>
__device__ void rank(const DispatchArgs& args, nanoseconds now, RoundCommon& common,
                     RoundMemory<kThreads, kItems>& memory) {
    using Memory = RoundMemory<kThreads, kItems>;
    using Ranked = typename Memory::Ranked;
    abi::SharedPage& page = *args.page;
    Ranked ranked[kItems];
    for (int i = 0; i < kItems; ++i) {
        // Neighbours by neighbouring threads: few tasks are read all at once.
        const int at = i * kThreads + static_cast<int>(threadIdx.x);
        const int task = nth_active(common.active, at);
        ranked[i] = {INT64_MAX, abi::kMaxTasks + at, at};
        if (task < 0) continue;
        const Entrant entrant = read_entrant(args, task, common.settings, now);
        memory.entrants[at] = entrant;
        ranked[i] = {entrant.contender.key, task, at};
        if (entrant.contender.needs_all) atomicAdd(&common.num_needing_all, 1);
        const std::int64_t laxity_ns = sched::urgent_laxity(entrant);
        if (laxity_ns != sched::kNoLaxity)
            atomicMin(&common.least_laxity_ns, static_cast<unsigned long long>(laxity_ns));
    }
    typename Memory::Sort(memory.sort).Sort(ranked, [](const Ranked& a, const Ranked& b) {
        return sched::comes_before(a.key, a.task, b.key, b.task);
    });
    __syncthreads();
    Before before[kItems];
    for (int i = 0; i < kItems; ++i)
        before[i] = ranked[i].task < abi::kMaxTasks
                        ? sched::as_before(memory.entrants[ranked[i].at].contender)
                        : Before{};
    typename Memory::Scan(memory.scan).ExclusiveScan(before, before, Before{}, cuda::std::plus<>{});
    for (int i = 0; i < kItems; ++i) {
        const int task = ranked[i].task;
        if (task >= abi::kMaxTasks) continue;
        const Entrant& self = memory.entrants[ranked[i].at];
        std::uint32_t opened = self.opened;
        if (self.is_gated) {
            const bool others_need_all = common.num_needing_all > self.contender.needs_all;
            opened = sched::opened_after(
                self, before[i], common.settings.limits, others_need_all,
                [&](std::uint32_t gate) { return sched::load_group(page.tasks[task], gate); });
            if (opened != self.opened) open(args, task, opened, now);
        }
        in_device(args.state->opened[task]).store(opened, cuda::memory_order_relaxed);
        const int place = static_cast<int>(threadIdx.x) * kItems + i;
        store_shared(page.ranked[task], abi::RankedWord{self.laxity_ns, place + 1}.pack(),
                     cuda::memory_order_relaxed);
    }
    __syncthreads();
}

/// What the threads of a round of marks, leases and arms share: few tasks are ranked sooner.
constexpr int kMarkThreads = 32, kFewItems = 2, kAllItems = abi::kMaxTasks / kMarkThreads;
struct RoundScratch {
    RoundCommon common;
    union {
        RoundMemory<kMarkThreads, kFewItems> few;
        RoundMemory<kMarkThreads, kAllItems> all;
        cub::BlockScan<std::uint64_t, kMarkThreads>::TempStorage urgent;
    };
};

// Apart: what it needs of registers is not the other's.
__device__ __noinline__ void rank_many(const DispatchArgs& args, nanoseconds now,
                                       RoundScratch& scratch) {
    rank(args, now, scratch.common, scratch.all);
}

/// @param ranks_many  else rounds of the host open the gates where many tasks are active: it takes
///                    85 us with 256, which a mark's stream would wait for
__device__ void run_round(const DispatchArgs& args, nanoseconds now, RoundScratch& scratch,
                          bool ranks_many = true) {
    begin_round<kMarkThreads>(args, scratch.common);
    if (nth_active(scratch.common.active, scratch.few.kMost) < 0)
        rank(args, now, scratch.common, scratch.few);
    else if (ranks_many)
        rank_many(args, now, scratch);
}

/// All threads of the block: the step within which the records of the lowest laxities pass the
/// share that TH_urgent leaves, as UrgentThreshold::reckon() does it. @param records  that there
/// are
__device__ __noinline__ void reckon_urgent(const DispatchArgs& args, std::uint64_t records,
                                           RoundScratch& scratch) {
    constexpr int kSteps = abi::kUrgentSteps / kMarkThreads;
    std::uint32_t* const counts = args.state->urgent_counts + kSteps * threadIdx.x;
    const auto count = [&](int i) { return in_device(counts[i]).load(cuda::memory_order_relaxed); };
    std::uint64_t own = 0, before = 0;
    for (int i = 0; i < kSteps; ++i) own += count(i);
    cub::BlockScan<std::uint64_t, kMarkThreads>(scratch.urgent).ExclusiveSum(own, before);
    const double below =
        sched::urgent_records(records, load_shared(args.page->dispatch.urgent_percentile));
    if (before > below || before + own <= below) return;
    for (int i = 0; i < kSteps; ++i) {
        before += count(i);
        if (before <= below) continue;
        store_shared(args.page->dispatch.gpu_urgent_laxity_ns,
                     sched::end_of_urgent_step(static_cast<std::uint32_t>(
                         kSteps * threadIdx.x + static_cast<unsigned>(i))),
                     cuda::memory_order_relaxed);
        return;
    }
}

/// All threads of the block, after a round, of which there is one at a time: its highest urgency is
/// recorded if that is due.
__device__ void record_urgency(const DispatchArgs& args, nanoseconds now, RoundScratch& scratch) {
    DispatchState& state = *args.state;
    std::uint64_t records = 0;
    if (threadIdx.x == 0) {
        const auto recorded = in_device(state.urgent_recorded_ns);
        const auto least_ns = static_cast<std::int64_t>(scratch.common.least_laxity_ns);
        if (least_ns != sched::kNoLaxity &&
            now.count() - recorded.load(cuda::memory_order_relaxed) >= abi::kUrgentEvery_ns) {
            recorded.store(now.count(), cuda::memory_order_relaxed);
            in_device(state.urgent_counts[sched::urgent_step_of(least_ns)])
                .fetch_add(1, cuda::memory_order_relaxed);
            records = in_device(state.urgent_records).fetch_add(1, cuda::memory_order_relaxed) + 1;
        }
    }
    records = __shfl_sync(~0u, records, 0);
    __syncthreads();
    if (records != 0 && records % abi::kUrgentEnough == 0) reckon_urgent(args, records, scratch);
    __syncthreads();
}

/// One round at a time; what changes meanwhile is seen by another one. Bounded: a mark ends.
///
/// No change is lost: who asks for a round sets `again` and then looks at `busy`; who ends one
/// clears `busy` and then looks at `again`, with a fence between the two in both.
__device__ void run_rounds(const DispatchArgs& args, RoundScratch& scratch,
                           bool ranks_many = true) {
    constexpr int kMostRounds = 4;
    DispatchState& state = *args.state;
    const auto fence = [] {
        cuda::atomic_thread_fence(cuda::memory_order_seq_cst, cuda::thread_scope_device);
    };
    if (threadIdx.x == 0) {
        in_device(state.again).store(1, cuda::memory_order_release);
        fence();
    }
    for (int i = 0; i < kMostRounds; ++i) {
        bool mine = false;
        if (threadIdx.x == 0) {
            std::uint32_t idle = 0;
            mine =
                in_device(state.again).load(cuda::memory_order_acquire) != 0 &&
                in_device(state.busy).compare_exchange_strong(idle, 1, cuda::memory_order_acq_rel);
            // What set it again meanwhile is seen by this round.
            if (mine) in_device(state.again).exchange(0, cuda::memory_order_acq_rel);
        }
        if (__syncthreads_or(mine) == 0) return;
        const std::uint64_t begin_ns = globaltimer_ns();
        const nanoseconds now = sched::host_time(args.page->dispatch, begin_ns);
        run_round(args, now, scratch, ranks_many);
        record_urgency(args, now, scratch);
        if (threadIdx.x == 0) {
            abi::DispatchSettings& page = args.page->dispatch;
            const std::uint32_t rounds =
                in_device(state.rounds).fetch_add(1, cuda::memory_order_relaxed) + 1;
            const std::uint64_t took_us = (globaltimer_ns() - begin_ns + 500) / 1000;
            const std::uint64_t total_us =
                in_device(state.rounds_us).fetch_add(took_us, cuda::memory_order_relaxed) + took_us;
            store_shared(page.gpu_rounds, rounds, cuda::memory_order_relaxed);
            store_shared(page.gpu_ranked_ns, static_cast<std::int64_t>(now.count()),
                         cuda::memory_order_relaxed);
            store_shared(page.gpu_round_us, total_us, cuda::memory_order_relaxed);
        }
        __threadfence();
        if (threadIdx.x == 0) {
            in_device(state.busy).store(0, cuda::memory_order_release);
            fence();
        }
        __syncthreads();
    }
}

}  // namespace
