// SPDX-License-Identifier: Apache-2.0
//
// An armed dispatcher (device/dispatcher.cu) on a GPU, from a mark that wakes an arm to the gates
// that this opens. Prints JSON; exit status 1: a difference, or a wake-up was lost; 77: no GPU.
//
//   1 Snapshots drawn at random: the same gates open as by the host's round, and the same laxities
//     and ranks are told, to the bit. The arm reads its own clock, and tells what it read: the host
//     decides as of that.
//   2 Bursts of marks on several streams, with arms ahead: after the last mark an arm begins that
//     knows of it, without a tick of the host's.
//
//   dispatch_armed [snapshots] [bursts] [seed]
#include <cuda.h>

#include <chrono>
#include <thread>

#include "tests/gpu/dispatch_draws.cuh"

namespace {

using Steady = std::chrono::steady_clock;
constexpr int kMarkStreams = 4, kMarksInBurst = 32, kArmsAhead = 48;

__global__ void read_time(std::uint64_t* time_ns) {
    *time_ns = globaltimer_ns();
}

cudaStream_t stream_at(int priority) {
    cudaStream_t stream = nullptr;
    must(cudaStreamCreateWithPriority(&stream, cudaStreamNonBlocking, priority), "stream");
    return stream;
}

struct Gpu {
    abi::SharedPage* page = new (mapped<abi::SharedPage>()) abi::SharedPage();
    abi::DispatchLease* lease = mapped<abi::DispatchLease>();
    std::uint64_t* line = mapped<std::uint64_t>(2 * abi::kMaxTasks);
    std::uint64_t* time_ns = mapped<std::uint64_t>();
    DispatchState* h_state = mapped<DispatchState>();
    DispatchState* d_state = nullptr;
    cudaStream_t arms = nullptr, marks[kMarkStreams] = {}, copies = nullptr;
    decltype(&cuStreamWaitValue32) wait_value = nullptr;
    std::uint32_t last = 0;  // arm

    Gpu() {
        int least = 0, greatest = 0;
        must(cudaDeviceGetStreamPriorityRange(&least, &greatest), "priorities");
        arms = stream_at(greatest);
        for (cudaStream_t& stream : marks) stream = stream_at(greatest);
        copies = stream_at(least);
        must(cudaMalloc(&d_state, sizeof *d_state), "state");
        must(cudaMemset(d_state, 0, sizeof *d_state), "state");
        constexpr unsigned kVersion = 12000;
        cudaDriverEntryPointQueryResult found{};
        void* entry = nullptr;
        must(cudaGetDriverEntryPointByVersion("cuStreamWaitValue32", &entry, kVersion,
                                              cudaEnableDefault, &found),
             "cuStreamWaitValue32");
        wait_value = reinterpret_cast<decltype(wait_value)>(entry);
        // What is launched for the first time may wait for all work.
        lease->stop = 1;
        urgengo_dispatch_armed<<<1, kMarkThreads, 0, arms>>>(args(2), 0);
        mark(0, 0, 1, 2, abi::MarkRanks::kForAll);
        now();
        must(cudaDeviceSynchronize(), "warm-up");
        std::memset(lease, 0, sizeof *lease);  // that mark has ticked the first arm
    }
    DispatchArgs args(std::uint32_t num_tasks) { return {page, d_state, lease, num_tasks, 0}; }
    void put_arm(std::uint32_t num_tasks) {
        ++last;
        const auto word = reinterpret_cast<CUdeviceptr>(&lease->ticks[last % abi::kArmRing]);
        if (wait_value(arms, word, last, CU_STREAM_WAIT_VALUE_GEQ) != CUDA_SUCCESS)
            must(cudaErrorNotSupported, "wait for a value");
        urgengo_dispatch_armed<<<1, kMarkThreads, 0, arms>>>(args(num_tasks), last);
        must(cudaGetLastError(), "arm");
    }
    void mark(int stream, std::uint32_t task, std::uint32_t gate, std::uint32_t num_tasks,
              abi::MarkRanks ranks) {
        // As many as marks have (exec/mark_width.h), and some number.
        constexpr int kThreads[] = {kMarkThreads, 96, 256};
        urgengo_gate_mark<<<1, kThreads[gate % 3], 0, marks[stream]>>>(
            line + 2 * task, 0, gate, page, d_state, lease, num_tasks, task, gate, ranks);
        must(cudaGetLastError(), "mark");
    }
    std::uint64_t now() {
        read_time<<<1, 1, 0, copies>>>(time_ns);
        must(cudaStreamSynchronize(copies), "time");
        return *time_ns;
    }
    std::uint32_t ended() const { return __atomic_load_n(&lease->ended, __ATOMIC_ACQUIRE); }
    void tick_through() {
        for (std::uint32_t i = ended() + 1; i <= last; ++i)
            __atomic_store_n(&lease->ticks[i % abi::kArmRing], i, __ATOMIC_SEQ_CST);
        must(cudaStreamSynchronize(arms), "arms");
    }
    std::uint32_t read_again() {
        must(cudaMemcpyAsync(&h_state->again, &d_state->again, sizeof h_state->again,
                             cudaMemcpyDeviceToHost, copies),
             "again");
        must(cudaStreamSynchronize(copies), "again");
        return h_state->again;
    }
};

/// @returns whether it is so before long
template <typename Condition>
bool becomes(Condition&& is_so) {
    const auto by = Steady::now() + std::chrono::milliseconds(500);
    while (!is_so())
        if (Steady::now() > by) return false;
    return true;
}

struct Counts {
    long gates = 0, opened = 0, different = 0, lost = 0;
};

/// What the GPU is taken to know of marks that the host has not seen. All seem to be closed.
void draw_state(DispatchState& state, Draw& draw, const abi::SharedPage& page, int num_tasks) {
    std::memset(&state, 0, sizeof state);
    for (int i = 0; i < num_tasks; ++i) {
        state.reached[i] = page.tasks[i].gates_opened + 1;
        state.opened[i] = page.tasks[i].gates_opened;
        state.marked[i] = draw.one_in(2);
        state.done[i] = page.tasks[i].marks_done + static_cast<std::uint32_t>(draw.upto(70));
    }
}

void compare(Gpu& gpu, Draw& draw, Counts& counts) {
    static auto* const host = static_cast<abi::SharedPage*>(std::calloc(1, sizeof *gpu.page));
    static sched::HostRounds host_rounds(*host);
    const int most = draw.one_in(4) ? abi::kMaxTasks : 64;
    const int num_tasks = 2 + static_cast<int>(draw.upto(most - 2));
    draw_page(*gpu.page, draw, num_tasks);
    draw_state(*gpu.h_state, draw, *gpu.page, num_tasks);
    gpu.h_state->started = gpu.last;
    const auto task = static_cast<std::uint32_t>(draw.upto(num_tasks - 1));
    const auto tag = gpu.h_state->done[task] + 1;
    must(cudaMemcpyAsync(gpu.d_state, gpu.h_state, sizeof *gpu.h_state, cudaMemcpyHostToDevice,
                         gpu.copies),
         "state");
    const std::uint64_t begin_ns = gpu.now();
    gpu.page->dispatch.gpu_clock_ahead = begin_ns - kNow_ns;
    gpu.page->dispatch.clock_base_ns = kNow_ns;
    for (int i = 0; i < num_tasks; ++i) gpu.page->ranked[i] = 0;
    std::memcpy(static_cast<void*>(host), gpu.page, sizeof *host);
    gpu.put_arm(static_cast<std::uint32_t>(num_tasks));
    gpu.mark(0, task, tag, static_cast<std::uint32_t>(num_tasks), abi::MarkRanks::kForAll);
    gpu.h_state->done[task] = gpu.h_state->reached[task] = tag;
    gpu.h_state->marked[task] = 1;
    if (!becomes([&] { return gpu.ended() == gpu.last; })) {
        ++counts.lost;
        return gpu.tick_through();
    }
    const nanoseconds decided(gpu.page->dispatch.gpu_ranked_ns);
    counts.different += decided.count() < kNow_ns;
    host_rounds.run(decided, gpu.h_state);
    for (int i = 0; i < num_tasks; ++i) {
        const abi::TaskSlot& its = gpu.page->tasks[i];
        counts.gates += its.gates_opened != its.gates_closed;
        counts.opened += its.gates_opened_by_gpu != 0;
        counts.different += its.gates_opened != host->tasks[i].gates_opened ||
                            gpu.page->ranked[i].load() != host->ranked[i].load();
        gpu.page->tasks[i].gates_opened_by_gpu = 0;
    }
}

/// Of the last snapshot's tasks.
void burst(Gpu& gpu, Draw& draw, Counts& counts) {
    constexpr std::uint32_t kTasks = 2;
    while (gpu.last - gpu.ended() < kArmsAhead) gpu.put_arm(kTasks);
    for (int i = 0; i < kMarksInBurst; ++i) {
        gpu.mark(static_cast<int>(draw.upto(kMarkStreams - 1)),
                 static_cast<std::uint32_t>(draw.upto(kTasks - 1)),
                 1'000'000 + static_cast<std::uint32_t>(draw.upto(1'000'000)), kTasks,
                 abi::MarkRanks::kForAll);
        if (draw.one_in(4)) std::this_thread::sleep_for(std::chrono::microseconds(draw.upto(40)));
    }
    for (cudaStream_t stream : gpu.marks) must(cudaStreamSynchronize(stream), "marks");
    if (becomes([&] { return gpu.read_again() == 0; })) return;
    ++counts.lost;
    gpu.tick_through();
}

}  // namespace

int main(int argc, char** argv) {
    const long snapshots = argc > 1 ? std::atol(argv[1]) : 20'000;
    const long bursts = argc > 2 ? std::atol(argv[2]) : 5'000;
    const auto seed = static_cast<std::uint64_t>(argc > 3 ? std::atoll(argv[3]) : 1);
    cudaDeviceProp properties{};
    must(cudaGetDeviceProperties(&properties, 0), "device");
    Gpu gpu;
    Draw draw(seed);
    Counts of_snapshots, of_bursts;
    for (long i = 0; i < snapshots; ++i) compare(gpu, draw, of_snapshots);
    const std::uint32_t before = gpu.last;
    for (long i = 0; i < bursts; ++i) burst(gpu, draw, of_bursts);
    gpu.tick_through();
    must(cudaDeviceSynchronize(), "end");
    std::printf(
        "{\"gpu\": \"%s\", \"armed_snapshots\": %ld, \"seed\": %llu, "
        "\"gated_tasks\": %ld, \"opened\": %ld, \"different\": %ld, \"bursts\": %ld, "
        "\"arms_in_bursts\": %u, \"lost_wake_ups\": %ld}\n",
        properties.name, snapshots, static_cast<unsigned long long>(seed), of_snapshots.gates,
        of_snapshots.opened, of_snapshots.different, bursts, gpu.last - before,
        of_snapshots.lost + of_bursts.lost);
    return of_snapshots.different == 0 && of_snapshots.opened > 0 &&
                   of_snapshots.lost + of_bursts.lost == 0
               ? 0
               : 1;
}
