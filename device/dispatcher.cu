// SPDX-License-Identifier: Apache-2.0
//
// The dispatcher on the GPU: ranks the tasks by urgency, and opens the gates of those that may go
// (host/sched/dispatch_round.h, which the host runs as well, to the bit). Three kernels run rounds:
//
//   urgengo_dispatch_mark   a progress mark that runs one if a gate is closed (piggyback)
//   urgengo_dispatch_lease  resident for the length of a lease, one after the other (leased)
//   urgengo_dispatch_armed  waits in a stream of ours until a mark wakes it (armed)
//   (urgengo_gate_mark      a progress mark that tells a lease, or wakes an arm)
//
// None has shared memory of its own, for which it would wait beside most kernels until one
// multiprocessor has no block (exec/mark_width.h; measured, docs/measurements.md): what a round's
// threads share lies in the GPU's memory.
//
// The GPU's own memory says whether a gate is closed, and which marks have executed; all else is
// read from the host's: a round takes 12 us with ten tasks, 30 with 256 (H100).
#include <cstdint>
#include <cub/block/block_merge_sort.cuh>
#include <cub/block/block_scan.cuh>
#include <cuda/atomic>

#include "host/sched/dispatch_round.h"
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

/// What the threads of a round share.
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
    std::uint64_t active[abi::kTaskWords];
    sched::RoundSettings settings;
    int num_needing_all;
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

/// All threads of the block. Ranks what is active, and opens what may go.
template <int kThreads, int kItems>
__device__ void run_round(const DispatchArgs& args, nanoseconds now,
                          RoundMemory<kThreads, kItems>& memory) {
    using Memory = RoundMemory<kThreads, kItems>;
    using Ranked = typename Memory::Ranked;
    abi::SharedPage& page = *args.page;
    if (threadIdx.x < abi::kTaskWords)
        memory.active[threadIdx.x] = load_shared(page.active[threadIdx.x]);
    if (threadIdx.x == kThreads - 1) {
        memory.settings = sched::load_settings(page.dispatch);
        memory.num_needing_all = 0;
    }
    __syncthreads();
    // Too many: the host's rounds do. Together: another block's round writes there once this one
    // ends.
    if (__syncthreads_or(nth_active(memory.active, Memory::kMost) >= 0) != 0) return;
    Ranked ranked[kItems];
    for (int i = 0; i < kItems; ++i) {
        // Neighbours by neighbouring threads: few tasks are read all at once.
        const int at = i * kThreads + static_cast<int>(threadIdx.x);
        const int task = nth_active(memory.active, at);
        ranked[i] = {INT64_MAX, abi::kMaxTasks + at, at};
        if (task < 0) continue;
        const Entrant entrant = read_entrant(args, task, memory.settings, now);
        memory.entrants[at] = entrant;
        ranked[i] = {entrant.contender.key, task, at};
        if (entrant.contender.needs_all) atomicAdd(&memory.num_needing_all, 1);
    }
    typename Memory::Sort(memory.sort).Sort(ranked, [](const Ranked& a, const Ranked& b) {
        return a.key != b.key ? a.key < b.key : a.task < b.task;
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
        if (self.is_gated) {
            const bool others_need_all = memory.num_needing_all > self.contender.needs_all;
            const std::uint32_t opened = sched::opened_after(
                self, before[i], memory.settings.limits, others_need_all,
                [&](std::uint32_t gate) { return sched::load_group(page.tasks[task], gate); });
            if (opened != self.opened) open(args, task, opened, now);
            in_device(args.state->opened[task]).store(opened, cuda::memory_order_relaxed);
        } else {
            in_device(args.state->opened[task]).store(self.opened, cuda::memory_order_relaxed);
        }
    }
    __syncthreads();
}

/// One round at a time; what changes meanwhile is seen by another one. Bounded: a mark ends.
template <int kThreads, int kItems>
__device__ void run_rounds(const DispatchArgs& args, RoundMemory<kThreads, kItems>& memory) {
    constexpr int kMostRounds = 4;
    DispatchState& state = *args.state;
    if (threadIdx.x == 0) in_device(state.again).store(1, cuda::memory_order_release);
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
        run_round(args, sched::host_time(args.page->dispatch, begin_ns), memory);
        if (threadIdx.x == 0) {
            abi::DispatchSettings& page = args.page->dispatch;
            const std::uint32_t rounds =
                in_device(state.rounds).fetch_add(1, cuda::memory_order_relaxed) + 1;
            const auto took_us =
                static_cast<std::uint32_t>((globaltimer_ns() - begin_ns + 500) / 1000);
            const std::uint32_t total_us =
                in_device(state.rounds_us).fetch_add(took_us, cuda::memory_order_relaxed) + took_us;
            store_shared(page.gpu_rounds, rounds, cuda::memory_order_relaxed);
            store_shared(page.gpu_round_us, total_us, cuda::memory_order_relaxed);
        }
        __threadfence();
        if (threadIdx.x == 0) in_device(state.busy).store(0, cuda::memory_order_release);
        __syncthreads();
    }
}

/// Thread 0. The arm that begins next sees what this thread has stored.
///
/// No wake-up is lost: a mark sets `again` and then reads which arm has begun; an arm says that it
/// has begun and then looks at `again`, with a fence between the two in both. So either the mark
/// knows of the arm and wakes the one after it, or the arm sees `again`. Marks that wake the same
/// arm are served by one.
__device__ void wake(const DispatchArgs& args) {
    DispatchState& state = *args.state;
    in_device(state.again).store(1, cuda::memory_order_release);
    cuda::atomic_thread_fence(cuda::memory_order_seq_cst, cuda::thread_scope_device);
    const std::uint32_t next = in_device(state.started).load(cuda::memory_order_relaxed) + 1;
    in_system(args.lease->ticks[next % abi::kArmRing]).store(next, cuda::memory_order_release);
}

/// The progress mark itself, by one thread (marks.cu), and what the dispatcher is to know of it.
__device__ void tell(std::uint64_t* line, std::uint64_t word0, std::uint64_t tag,
                     DispatchState& state, std::uint32_t task, std::uint32_t gate) {
    const std::uint64_t word1 = globaltimer_ns() << 16 | (tag & 0xffff);
    asm volatile("st.volatile.global.v2.u64 [%0], {%1, %2};" ::"l"(line), "l"(word0), "l"(word1)
                 : "memory");
    in_device(state.done[task]).store(static_cast<std::uint32_t>(tag), cuda::memory_order_relaxed);
    in_device(state.reached[task]).store(gate, cuda::memory_order_relaxed);
    in_device(state.marked[task]).store(1, cuda::memory_order_release);
    in_device(state.tick).fetch_add(1, cuda::memory_order_release);
}

/// Of a kernel that was launched with programmatic serialisation (marks.cu).
__device__ void wait_for_what_is_before() {
#if __CUDA_ARCH__ >= 900
    asm volatile("griddepcontrol.wait;" ::: "memory");
#endif
}

constexpr int kMarkThreads = 32, kMarkItems = abi::kMostRankedByMark / kMarkThreads;

using MarkRound = RoundMemory<kMarkThreads, kMarkItems>;
alignas(MarkRound) __device__ unsigned char d_round_bytes[sizeof(MarkRound)];

/// Of the one round at a time that a context's kernels run (DispatchState::busy).
__device__ MarkRound& round_memory() {
    return *reinterpret_cast<MarkRound*>(d_round_bytes);
}

}  // namespace

// As urgengo_mark (marks.cu), then wakes an arm, if it is told of any and a gate is closed. What is
// behind it on its stream is behind this gate of its task, too, or beyond it. Any number of
// threads.
extern "C" __global__ void urgengo_gate_mark(std::uint64_t* line, std::uint64_t word0,
                                             std::uint64_t tag, abi::SharedPage* page,
                                             DispatchState* its_state, abi::DispatchLease* arms,
                                             std::uint32_t num_tasks, std::uint32_t task,
                                             std::uint32_t gate, abi::MarkRanks ranks) {
    const DispatchArgs args{page, its_state, arms, num_tasks, 0};
    wait_for_what_is_before();
    if (threadIdx.x == 0) tell(line, word0, tag, *args.state, task, gate);
    if (!arms || ranks == abi::MarkRanks::kNever) return;
    __syncthreads();
    // By the GPU's own memory: what the host has opened since costs an arm, not this stream.
    const bool is_due = ranks == abi::MarkRanks::kForAll ? any_closed(args, blockDim.x)
                                                         : is_closed(*args.state, task);
    if (is_due && threadIdx.x == 0) wake(args);
}

// The same, but for arms, and a round if a gate is closed.
extern "C" __global__ void __launch_bounds__(kMarkThreads)
    urgengo_dispatch_mark(std::uint64_t* line, std::uint64_t word0, std::uint64_t tag,
                          abi::SharedPage* page, DispatchState* its_state, abi::DispatchLease*,
                          std::uint32_t num_tasks, std::uint32_t task, std::uint32_t gate,
                          abi::MarkRanks ranks) {
    const DispatchArgs args{page, its_state, nullptr, num_tasks, 0};
    wait_for_what_is_before();
    if (threadIdx.x == 0) tell(line, word0, tag, *args.state, task, gate);
    if (ranks == abi::MarkRanks::kNever) return;
    __syncthreads();
    // What the host may change meanwhile is read by one thread, for all.
    bool is_due = false;
    if (threadIdx.x == 0)
        is_due = knows_time(args) && (ranks == abi::MarkRanks::kForAll ||
                                      load_shared(args.page->tasks[task].gates_opened) != gate);
    if (__syncthreads_or(is_due) == 0) return;
    if (ranks == abi::MarkRanks::kForAll && !any_closed(args, kMarkThreads)) return;
    run_rounds(args, round_memory());
}

// Resident for `lease_ns` at most, until the host says stop, or until no gate was closed for a
// while.
extern "C" __global__ void __launch_bounds__(kMarkThreads)
    urgengo_dispatch_lease(DispatchArgs args, std::uint32_t sequence, std::uint64_t lease_ns) {
    constexpr std::uint64_t kIdle_ns = 200'000;
    const std::uint64_t begin_ns = globaltimer_ns();
    std::uint64_t needed_ns = begin_ns, looked_ns = begin_ns;  // of thread 0
    std::uint32_t last_tick = 0;
    for (;;) {
        const bool is_needed = __syncthreads_or(threadIdx.x == 0 && knows_time(args)) != 0 &&
                               any_closed(args, kMarkThreads);
        bool ends = false;
        const bool is_awaited = !is_needed && any_to_come<kMarkThreads>(args);
        if (threadIdx.x == 0) {
            const std::uint64_t now_ns = globaltimer_ns();
            if (is_needed || is_awaited) needed_ns = now_ns;
            if (now_ns - looked_ns > abi::kGap_ns) {  // one lease at a time counts
                const auto gaps = in_system(args.lease->gaps);
                gaps.store(gaps.load(cuda::memory_order_relaxed) + 1, cuda::memory_order_relaxed);
            }
            looked_ns = now_ns;
            ends = now_ns - begin_ns > lease_ns || now_ns - needed_ns > kIdle_ns ||
                   in_system(args.lease->stop).load(cuda::memory_order_acquire) != 0;
        }
        if (__syncthreads_or(ends) != 0) break;
        if (is_needed) run_rounds(args, round_memory());
        const std::uint32_t tick = in_device(args.state->tick).load(cuda::memory_order_acquire);
        if (tick == last_tick) __nanosleep(2000);  // nothing changes but the time
        last_tick = tick;
        __syncthreads();
    }
    if (threadIdx.x == 0) in_system(args.lease->ended).store(sequence, cuda::memory_order_release);
}

// Behind a wait for its tick, and at most a few rounds long. The host ticks it, too, so that
// nothing of ours is left in its stream: then there is nothing to do, or `stop` is set.
extern "C" __global__ void __launch_bounds__(kMarkThreads)
    urgengo_dispatch_armed(DispatchArgs args, std::uint32_t number) {
    DispatchState& state = *args.state;
    bool is_due = false;
    if (threadIdx.x == 0) {
        in_device(state.started).store(number, cuda::memory_order_relaxed);
        cuda::atomic_thread_fence(cuda::memory_order_seq_cst, cuda::thread_scope_device);
        is_due = in_device(state.again).load(cuda::memory_order_acquire) != 0 &&
                 in_system(args.lease->stop).load(cuda::memory_order_acquire) == 0 &&
                 knows_time(args);
    }
    if (__syncthreads_or(is_due) != 0) {
        run_rounds(args, round_memory());
        // Of tasks that no round looks at: the host opens the gates of those that are not active.
        for (std::uint32_t i = threadIdx.x; i < args.num_tasks; i += kMarkThreads)
            if (is_closed(state, i) && !is_in(args.page->active, static_cast<int>(i)))
                in_device(state.opened[i])
                    .store(load_shared(args.page->tasks[i].gates_opened),
                           cuda::memory_order_relaxed);
    }
    __syncthreads();
    if (threadIdx.x == 0) in_system(args.lease->ended).store(number, cuda::memory_order_release);
}
