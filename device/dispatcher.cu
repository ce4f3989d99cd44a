// SPDX-License-Identifier: Apache-2.0
//
// The dispatcher on the GPU: ranks the tasks by urgency, and opens the gates of those that may go
// (dispatch_round.cuh). Three kernels run rounds:
//
//   urgengo_dispatch_mark   a progress mark that runs one if a gate is closed (piggyback)
//   urgengo_dispatch_lease  resident for the length of a lease, one after the other (leased)
//   urgengo_dispatch_armed  waits in a stream of ours until a mark wakes it (armed)
//   (urgengo_gate_mark      a progress mark that tells a lease, or wakes an arm)
//
// None has shared memory of its own, for which it would wait beside most kernels until one
// multiprocessor has no block (exec/mark_width.h; measured, docs/measurements.md): what a round's
// threads share lies in the GPU's memory.
#include "device/dispatch_round.cuh"

namespace {

alignas(RoundScratch) __device__ unsigned char d_round_bytes[sizeof(RoundScratch)];

/// Of the one round at a time that a context's kernels run (DispatchState::busy).
__device__ RoundScratch& round_scratch() {
    return *reinterpret_cast<RoundScratch*>(d_round_bytes);
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

/// One thread. @returns whether no lease follows this one
__device__ bool is_last(const DispatchArgs& args, std::uint32_t sequence) {
    return in_system(args.lease->launched).load(cuda::memory_order_acquire) == sequence;
}

/// One thread. @returns whether the host opens no gate any more
__device__ bool is_silent(const DispatchArgs& args, std::uint64_t now_ns) {
    const abi::DispatchSettings& page = args.page->dispatch;
    return knows_time(args) && sched::is_silent(page, sched::host_time(page, now_ns));
}

/// One thread, the only one that writes it.
__device__ void count(std::uint32_t& times) {
    const auto its = in_system(times);
    its.store(its.load(cuda::memory_order_relaxed) + 1, cuda::memory_order_relaxed);
}

/// All threads of the block.
__device__ void open_all(const DispatchArgs& args) {
    const nanoseconds now = sched::host_time(args.page->dispatch, globaltimer_ns());
    for (std::uint32_t i = threadIdx.x; i < args.num_tasks; i += blockDim.x) {
        const std::uint32_t closed = load_shared(args.page->tasks[i].gates_closed);
        if (closed == load_shared(args.page->tasks[i].gates_opened)) continue;
        open(args, static_cast<int>(i), closed, now);
        in_device(args.state->opened[i]).store(closed, cuda::memory_order_relaxed);
    }
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
    run_rounds(args, round_scratch(), false);
}

// Resident for `lease_ns` at most, until the host says stop, or until no gate was closed for
// `idle_ns`. The last lease stays for up to 20 ms more while gates are closed: until another one
// follows, or the host has been silent for long enough that all gates open (abi::kSilence_ns).
extern "C" __global__ void __launch_bounds__(kMarkThreads)
    urgengo_dispatch_lease(DispatchArgs args, std::uint32_t sequence, std::uint64_t lease_ns,
                           std::uint64_t idle_ns) {
    const std::uint64_t begin_ns = globaltimer_ns();
    std::uint64_t needed_ns = begin_ns, looked_ns = begin_ns;  // of thread 0
    std::uint32_t last_tick = 0;
    for (;;) {
        const bool is_needed = __syncthreads_or(threadIdx.x == 0 && knows_time(args)) != 0 &&
                               any_closed(args, kMarkThreads);
        bool ends = false, is_forsaken = false;
        const bool is_awaited = !is_needed && any_to_come<kMarkThreads>(args);
        if (threadIdx.x == 0) {
            const std::uint64_t now_ns = globaltimer_ns();
            if (is_needed || is_awaited) needed_ns = now_ns;
            if (now_ns - looked_ns > abi::kGap_ns) count(args.lease->gaps);
            looked_ns = now_ns;
            const bool is_over = now_ns - begin_ns > lease_ns;
            const bool stays = is_over && lease_ns > 0 && (is_needed || is_awaited) &&
                               is_last(args, sequence) &&
                               now_ns - begin_ns < lease_ns + 2 * abi::kSilence_ns;
            is_forsaken = stays && is_silent(args, now_ns);
            ends = (is_over && !stays) || now_ns - needed_ns > idle_ns ||
                   in_system(args.lease->stop).load(cuda::memory_order_acquire) != 0;
        }
        if (__syncthreads_or(ends) != 0) break;
        if (__syncthreads_or(is_forsaken) != 0) {
            open_all(args);
            if (threadIdx.x == 0) count(args.lease->forsaken);
            break;
        }
        if (is_needed) run_rounds(args, round_scratch());
        const std::uint32_t tick = in_device(args.state->tick).load(cuda::memory_order_acquire);
        if (tick == last_tick) __nanosleep(2000);  // nothing changes but the time
        last_tick = tick;
        __syncthreads();
    }
    __syncthreads();
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
        run_rounds(args, round_scratch());
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
