// SPDX-License-Identifier: Apache-2.0
//
// The same snapshot, decided by the host and by the GPU: the same gates open, to the bit. A
// snapshot is a page of tasks drawn at random; the host's round (std::stable_sort, one sum after
// the other) and the GPU's (CUB), one block a snapshot, each get a copy. Prints JSON; exit status
// 1: a difference; 77: no GPU.
//
//   dispatch_equality [snapshots] [seed]
#include <chrono>

#include "tests/gpu/dispatch_draws.cuh"

namespace {

constexpr int kPages = 128;
constexpr int kRankThreads = abi::kMaxTasks;  // a task each

template <int kThreads, int kItems>
__global__ void rounds(const DispatchArgs* args) {
    __shared__ RoundMemory<kThreads, kItems> memory;
    run_round(args[blockIdx.x], nanoseconds(kNow_ns), memory);
}

/// How long a round takes, on the GPU.
template <int kThreads, int kItems>
__global__ void timed_rounds(const DispatchArgs* args, int num_rounds, std::uint64_t* took_ns) {
    __shared__ RoundMemory<kThreads, kItems> memory;
    const std::uint64_t begin_ns = globaltimer_ns();
    for (int i = 0; i < num_rounds; ++i) run_round(*args, nanoseconds(kNow_ns), memory);
    if (threadIdx.x == 0) *took_ns = globaltimer_ns() - begin_ns;
}

}  // namespace

int main(int argc, char** argv) {
    const long snapshots = argc > 1 ? std::atol(argv[1]) : 100'000;
    const auto seed = static_cast<std::uint64_t>(argc > 2 ? std::atoll(argv[2]) : 1);
    cudaDeviceProp properties{};
    must(cudaGetDeviceProperties(&properties, 0), "device");
    char* memory = nullptr;
    must(cudaHostAlloc(reinterpret_cast<void**>(&memory), kPages * sizeof(abi::SharedPage),
                       cudaHostAllocMapped),
         "memory");
    DispatchState* states = nullptr;
    must(cudaMalloc(&states, kPages * sizeof(DispatchState)), "states");
    must(cudaMemset(states, 0, kPages * sizeof(DispatchState)), "states");
    DispatchArgs* args = nullptr;
    must(cudaHostAlloc(reinterpret_cast<void**>(&args), kPages * sizeof(DispatchArgs),
                       cudaHostAllocMapped),
         "arguments");
    auto* host = static_cast<abi::SharedPage*>(std::calloc(1, sizeof(abi::SharedPage)));
    abi::SharedPage* pages[kPages];
    for (int i = 0; i < kPages; ++i) {
        pages[i] =
            new (memory + static_cast<std::size_t>(i) * sizeof(abi::SharedPage)) abi::SharedPage();
        args[i] = {pages[i], &states[i], nullptr, abi::kMaxTasks, 0};
    }
    std::uint64_t* took_ns = nullptr;
    must(cudaHostAlloc(reinterpret_cast<void**>(&took_ns), sizeof *took_ns, cudaHostAllocMapped),
         "time");
    Draw draw(seed);
    sched::HostRounds host_rounds(*host);
    std::vector<std::vector<std::uint32_t>> expected(kPages);
    long opened = 0, different = 0, gates = 0, largest = 0;
    for (long done = 0; done < snapshots; done += kPages) {
        // 64 tasks at most fit a mark's round; larger ones take a block.
        const int kind = static_cast<int>(draw.upto(9));
        const int most = kind == 0 ? 256 : kind < 3 ? 64 : 16;
        for (int i = 0; i < kPages; ++i) {
            const int num_tasks = 2 + static_cast<int>(draw.upto(most - 2));
            largest = std::max<long>(largest, num_tasks);
            draw_page(*pages[i], draw, num_tasks);
            std::memcpy(static_cast<void*>(host), pages[i], sizeof(abi::SharedPage));
            host_rounds.run(nanoseconds(kNow_ns));
            expected[static_cast<std::size_t>(i)].clear();
            for (int task = 0; task < num_tasks; ++task) {
                expected[static_cast<std::size_t>(i)].push_back(host->tasks[task].gates_opened);
                const abi::TaskSlot& before = pages[i]->tasks[task];
                gates += before.gates_opened != before.gates_closed;
                opened += host->tasks[task].gates_opened != before.gates_opened;
            }
        }
        if (most > abi::kMostRankedByMark)
            rounds<kRankThreads, 1><<<kPages, kRankThreads>>>(args);
        else
            rounds<kMarkThreads, kMarkItems><<<kPages, kMarkThreads>>>(args);
        must(cudaGetLastError(), "launch");
        must(cudaDeviceSynchronize(), "round");
        for (int i = 0; i < kPages; ++i)
            for (std::size_t task = 0; task < expected[static_cast<std::size_t>(i)].size();
                 ++task) {
                const std::uint32_t its = pages[i]->tasks[task].gates_opened;
                const std::uint32_t by_host = expected[static_cast<std::size_t>(i)][task];
                if (its == by_host) continue;
                ++different;
                std::fprintf(
                    stderr,
                    "snapshot %ld (policy %u, %zu tasks, %d at most), task %zu: gates open "
                    "by the GPU %u, by the host %u\n",
                    done + i, pages[i]->dispatch.policy.load(),
                    expected[static_cast<std::size_t>(i)].size(), most, task, its, by_host);
            }
    }
    const auto time_rounds = [&](int num_tasks, bool by_block) {
        constexpr int kRounds = 2'000;
        draw_page(*pages[0], draw, num_tasks);
        for (auto& word : pages[0]->active) word = 0;
        for (int task = 0; task < num_tasks; ++task)
            pages[0]->active[task / 64] |= std::uint64_t{1} << (task % 64);
        std::memcpy(static_cast<void*>(host), pages[0], sizeof(abi::SharedPage));
        const auto begin = std::chrono::steady_clock::now();
        for (int i = 0; i < kRounds; ++i) host_rounds.run(nanoseconds(kNow_ns));
        const double host_ns =
            std::chrono::duration<double, std::nano>(std::chrono::steady_clock::now() - begin)
                .count();
        if (by_block)
            timed_rounds<kRankThreads, 1><<<1, kRankThreads>>>(args, kRounds, took_ns);
        else
            timed_rounds<kMarkThreads, kMarkItems><<<1, kMarkThreads>>>(args, kRounds, took_ns);
        must(cudaDeviceSynchronize(), "timed rounds");
        std::printf(
            "{\"tasks\": %d, \"threads\": %d, \"gpu_round_us\": %.2f, "
            "\"cpu_round_us\": %.2f}\n",
            num_tasks, by_block ? kRankThreads : kMarkThreads,
            1e-3 * static_cast<double>(*took_ns) / kRounds, 1e-3 * host_ns / kRounds);
    };
    time_rounds(10, false);
    time_rounds(10, true);
    time_rounds(64, false);
    time_rounds(64, true);
    time_rounds(256, true);
    std::printf(
        "{\"gpu\": \"%s\", \"snapshots\": %ld, \"seed\": %llu, \"most_tasks\": %ld, "
        "\"gated_tasks\": %ld, \"opened\": %ld, \"different\": %ld}\n",
        properties.name, snapshots, static_cast<unsigned long long>(seed), largest, gates, opened,
        different);
    return different == 0 && opened > 0 ? 0 : 1;
}
