// SPDX-License-Identifier: Apache-2.0
//
// The same snapshot, decided by the host and by the GPU: the same gates open, and the same laxities
// and ranks are told, to the bit. A snapshot is a page of tasks drawn at random; the host's round
// (std::stable_sort, one sum after the other) and the GPU's (CUB), one block a snapshot, each get a
// copy. Then TH_urgent of laxities drawn at random, by both. Prints JSON; exit status 1: a
// difference; 77: no GPU.
//
//   dispatch_equality [snapshots] [seed]
#include <chrono>

#include "host/sched/urgent_threshold.h"
#include "tests/gpu/dispatch_draws.cuh"

namespace {

constexpr int kPages = 128;
constexpr int kRankThreads = abi::kMaxTasks;  // a task each

/// As marks, leases and arms have it, one a block.
__global__ void rounds(const DispatchArgs* args, RoundScratch* scratch) {
    run_round(args[blockIdx.x], nanoseconds(kNow_ns), scratch[blockIdx.x]);
}

__device__ void run_wide_round(const DispatchArgs& args, RoundCommon& common,
                               RoundMemory<kRankThreads, 1>& memory) {
    begin_round<kRankThreads>(args, common);
    rank(args, nanoseconds(kNow_ns), common, memory);
}
/// How long a round takes, on the GPU.
__global__ void timed_rounds(const DispatchArgs* args, int num_rounds, RoundScratch* scratch,
                             std::uint64_t* took_ns) {
    const std::uint64_t begin_ns = globaltimer_ns();
    for (int i = 0; i < num_rounds; ++i) run_round(*args, nanoseconds(kNow_ns), *scratch);
    if (threadIdx.x == 0) *took_ns = globaltimer_ns() - begin_ns;
}
__global__ void timed_wide_rounds(const DispatchArgs* args, int num_rounds,
                                  std::uint64_t* took_ns) {
    __shared__ RoundCommon common;
    __shared__ RoundMemory<kRankThreads, 1> memory;
    const std::uint64_t begin_ns = globaltimer_ns();
    for (int i = 0; i < num_rounds; ++i) run_wide_round(*args, common, memory);
    if (threadIdx.x == 0) *took_ns = globaltimer_ns() - begin_ns;
}

/// Records these laxities, one a round.
__global__ void urgencies(const DispatchArgs* args, const std::int64_t* laxities_ns, int count,
                          RoundScratch* scratch) {
    for (int i = 0; i < count; ++i) {
        if (threadIdx.x == 0)
            scratch->common.least_laxity_ns = static_cast<unsigned long long>(laxities_ns[i]);
        __syncthreads();
        record_urgency(*args, nanoseconds((i + 1) * abi::kUrgentEvery_ns), *scratch);
    }
}

/// @returns how often host and GPU have found another TH_urgent
long compare_thresholds(const DispatchArgs* args, RoundScratch* scratch, Draw& draw, int times) {
    constexpr int kMost = 5 * abi::kUrgentEnough;
    auto* const laxities_ns = mapped<std::int64_t>(kMost);
    long different = 0;
    for (int i = 0; i < times; ++i) {
        must(cudaMemset(args->state, 0, sizeof *args->state), "state");
        const double percentile = draw.one_in(2) ? 95 : static_cast<double>(draw.upto(100));
        args->page->dispatch.urgent_percentile = percentile;
        args->page->dispatch.gpu_urgent_laxity_ns = 0;
        const int count = static_cast<int>(draw.upto(kMost));
        const std::int64_t far = std::int64_t{1} << draw.upto(40);
        sched::UrgentThreshold threshold(percentile);
        for (int k = 0; k < count; ++k) {
            laxities_ns[k] = draw.upto(far);
            threshold.record(nanoseconds(laxities_ns[k]));
        }
        urgencies<<<1, kMarkThreads>>>(args, laxities_ns, count, scratch);
        must(cudaDeviceSynchronize(), "urgencies");
        different += args->page->dispatch.gpu_urgent_laxity_ns.load() !=
                     threshold.laxity().value_or(nanoseconds{0}).count();
    }
    return different;
}

}  // namespace

int main(int argc, char** argv) {
    const long snapshots = argc > 1 ? std::atol(argv[1]) : 100'000;
    const auto seed = static_cast<std::uint64_t>(argc > 2 ? std::atoll(argv[2]) : 1);
    cudaDeviceProp properties{};
    must(cudaGetDeviceProperties(&properties, 0), "device");
    char* const memory = mapped<char>(kPages * sizeof(abi::SharedPage));
    DispatchState* states = nullptr;
    must(cudaMalloc(&states, kPages * sizeof(DispatchState)), "states");
    must(cudaMemset(states, 0, kPages * sizeof(DispatchState)), "states");
    RoundScratch* scratch = nullptr;
    must(cudaMalloc(&scratch, kPages * sizeof(RoundScratch)), "scratch");
    auto* const args = mapped<DispatchArgs>(kPages);
    auto* host = static_cast<abi::SharedPage*>(std::calloc(1, sizeof(abi::SharedPage)));
    abi::SharedPage* pages[kPages];
    for (int i = 0; i < kPages; ++i) {
        pages[i] =
            new (memory + static_cast<std::size_t>(i) * sizeof(abi::SharedPage)) abi::SharedPage();
        args[i] = {pages[i], &states[i], nullptr, abi::kMaxTasks, 0};
    }
    auto* const took_ns = mapped<std::uint64_t>(1);
    Draw draw(seed);
    sched::HostRounds host_rounds(*host);
    struct Told {
        std::uint32_t opened;
        std::int64_t ranked;
        bool operator==(const Told&) const = default;
    };
    std::vector<std::vector<Told>> expected(kPages);
    long opened = 0, different = 0, gates = 0, largest = 0;
    for (long done = 0; done < snapshots; done += kPages) {
        // About as many as a round of few ranks are drawn often.
        constexpr int kMany = 80;
        const int kind = static_cast<int>(draw.upto(9));
        const int most = kind == 0 ? 256 : kind < 4 ? kMany : 16;
        for (int i = 0; i < kPages; ++i) {
            const int num_tasks = 2 + static_cast<int>(draw.upto(most - 2));
            largest = std::max<long>(largest, num_tasks);
            draw_page(*pages[i], draw, num_tasks);
            std::memcpy(static_cast<void*>(host), pages[i], sizeof(abi::SharedPage));
            host_rounds.run(nanoseconds(kNow_ns));
            expected[static_cast<std::size_t>(i)].clear();
            for (int task = 0; task < num_tasks; ++task) {
                expected[static_cast<std::size_t>(i)].push_back(
                    {host->tasks[task].gates_opened, host->ranked[task]});
                const abi::TaskSlot& before = pages[i]->tasks[task];
                gates += before.gates_opened != before.gates_closed;
                opened += host->tasks[task].gates_opened != before.gates_opened;
            }
        }
        rounds<<<kPages, kMarkThreads>>>(args, scratch);
        must(cudaGetLastError(), "launch");
        must(cudaDeviceSynchronize(), "round");
        for (int i = 0; i < kPages; ++i)
            for (std::size_t task = 0; task < expected[static_cast<std::size_t>(i)].size();
                 ++task) {
                const abi::TaskSlot& slot = pages[i]->tasks[task];
                const Told its{slot.gates_opened, pages[i]->ranked[task]};
                const Told by_host = expected[static_cast<std::size_t>(i)][task];
                if (its == by_host) continue;
                ++different;
                std::fprintf(
                    stderr,
                    "snapshot %ld (policy %u, %zu tasks, %d at most), task %zu: gates open "
                    "by the GPU %u, by the host %u; ranked %lld, %lld\n",
                    done + i, pages[i]->dispatch.policy.load(),
                    expected[static_cast<std::size_t>(i)].size(), most, task, its.opened,
                    by_host.opened, static_cast<long long>(its.ranked),
                    static_cast<long long>(by_host.ranked));
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
            timed_wide_rounds<<<1, kRankThreads>>>(args, kRounds, took_ns);
        else
            timed_rounds<<<1, kMarkThreads>>>(args, kRounds, scratch, took_ns);
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
    time_rounds(256, false);
    time_rounds(256, true);
    constexpr int kThresholds = 300;
    const long thresholds_different = compare_thresholds(args, scratch, draw, kThresholds);
    std::printf(
        "{\"gpu\": \"%s\", \"snapshots\": %ld, \"seed\": %llu, \"most_tasks\": %ld, "
        "\"gated_tasks\": %ld, \"opened\": %ld, \"different\": %ld, "
        "\"thresholds\": %d, \"thresholds_different\": %ld}\n",
        properties.name, snapshots, static_cast<unsigned long long>(seed), largest, gates, opened,
        different, kThresholds, thresholds_different);
    return different + thresholds_different == 0 && opened > 0 ? 0 : 1;
}
