// SPDX-License-Identifier: Apache-2.0
//
// The same snapshot, decided by the host and by the GPU: the same gates open, to the bit. A
// snapshot is a page of tasks drawn at random; the host's round (std::stable_sort, one sum after
// the other) and the GPU's (CUB), one block a snapshot, each get a copy. Prints JSON; exit status
// 1: a difference; 77: no GPU.
//
//   dispatch_equality [snapshots] [seed]
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <new>
#include <random>

#include "device/dispatcher.cu"

namespace {

constexpr int kPages = 128;
constexpr int kRankThreads = abi::kMaxTasks;  // a task each
constexpr std::int64_t kNow_ns = 5'000'000'000;

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

void must(cudaError_t error, const char* what) {
    if (error == cudaSuccess) return;
    std::fprintf(stderr, "dispatch_equality: %s: %s\n", what, cudaGetErrorString(error));
    std::exit(error == cudaErrorNoDevice || error == cudaErrorInsufficientDriver ? 77 : 1);
}

class Draw {
  public:
    explicit Draw(std::uint64_t seed) : engine_(seed) {}
    std::int64_t upto(std::int64_t most) {
        return std::uniform_int_distribution<std::int64_t>(0, most)(engine_);
    }
    bool one_in(int n) { return upto(n - 1) == 0; }
    std::int64_t around_now(std::int64_t far) { return kNow_ns - far + upto(2 * far); }

  private:
    std::mt19937_64 engine_;
};

void draw_slot(abi::TaskSlot& s, Draw& draw, int task) {
    constexpr std::int64_t kMs = 1'000'000;
    s.version = draw.one_in(20) ? 1 : 2;
    s.state = static_cast<abi::TaskState>(draw.upto(4));
    s.deadline_ns = draw.around_now(100 * kMs);
    s.later_gpu_ns = draw.upto(20 * kMs);
    s.later_cpu_ns = draw.upto(10 * kMs);
    s.later_idle_ns = draw.one_in(3) ? draw.upto(5 * kMs) : 0;
    s.cpu_until_ns = draw.around_now(5 * kMs);
    s.period_ns = 10 * kMs + draw.upto(100 * kMs);
    s.criticality = static_cast<std::uint16_t>(draw.upto(3));
    s.demotes = draw.one_in(8);
    s.head_utilization_ppm = static_cast<std::uint32_t>(draw.upto(1'000'000));
    s.head_remaining_ns = draw.one_in(4) ? 0 : draw.upto(20 * kMs);
    s.head_idle_ns = draw.one_in(2) ? draw.upto(10 * kMs) : 0;
    s.launched_ns = draw.upto(50 * kMs);
    s.launch_ns = draw.around_now(kMs);
    s.look_ns = draw.around_now(kMs);
    s.sync_until_ns = draw.around_now(5 * kMs);
    s.started = draw.one_in(2);
    s.unmarked_until_ns = draw.one_in(4) ? draw.around_now(5 * kMs) : 0;
    s.progress_ns = draw.around_now(3 * kMs);
    s.cleared_until_ns = draw.one_in(8) ? draw.around_now(kMs) : 0;
    s.turn_until_ns = draw.one_in(16) ? draw.around_now(kMs) : 0;
    s.relative_deadline_ns = 20 * kMs + draw.upto(100 * kMs);
    s.chain_gpu_ns = draw.upto(30 * kMs);
    s.chain_cpu_ns = draw.upto(30 * kMs);
    s.static_rank = static_cast<std::uint32_t>(draw.upto(16));
    s.mean_utilization_ppm = static_cast<std::uint32_t>(draw.upto(1'000'000));
    s.factor_ppm = draw.one_in(2) ? 0 : 500'000 + static_cast<std::uint32_t>(draw.upto(1'000'000));
    s.is_supported = draw.one_in(2);
    s.launching = static_cast<abi::Launching>(draw.upto(2));
    s.lent_until_ns = draw.one_in(6) ? draw.upto(60 * kMs) : 0;
    s.lent_deadline_ns = draw.around_now(50 * kMs);
    s.lent_static_rank = static_cast<std::uint32_t>(draw.upto(16));
    s.lent_criticality = static_cast<std::uint16_t>(draw.upto(3));
    s.waits = draw.one_in(3);
    s.queue_why = draw.one_in(3) ? abi::Why::kTurnToLaunch : abi::Why::kRank;
    const auto done = static_cast<std::uint32_t>(draw.upto(1'000));
    s.marks_done = done;
    s.marks_issued = done + static_cast<std::uint32_t>(draw.upto(70));
    for (auto& at : s.launched_at_mark_ns) at = draw.upto(50 * kMs);
    const auto opened = static_cast<std::uint32_t>(draw.upto(1'000));
    s.gates_opened = opened;
    s.gates_closed =
        opened + (draw.one_in(2) ? 0 : static_cast<std::uint32_t>(draw.upto(abi::kGateRing - 1)));
    s.gate_by_ns = kNow_ns + (draw.one_in(16) ? 0 : draw.upto(100 * kMs));
    s.gate_opened_ns = draw.around_now(3 * kMs);
    s.run_ahead_ns = draw.upto(5 * kMs);
    for (std::uint32_t i = 0; i < abi::kGateRing; ++i) {
        s.group_begin_ns[i] = draw.upto(50 * kMs);
        s.group_time_ns[i] = draw.upto(kMs);
        s.group_utilization_ppm[i] = static_cast<std::uint32_t>(draw.upto(1'000'000));
    }
    (void)task;
}

void draw_page(abi::SharedPage& page, Draw& draw, int num_tasks) {
    for (auto& word : page.active) word = 0;
    abi::DispatchSettings& d = page.dispatch;
    d.policy = static_cast<std::uint32_t>(draw.upto(10));
    d.parked = draw.one_in(30);
    d.lambda = draw.one_in(2) ? 1 : -1;
    d.pack_limit_ppm = 1'050'000;
    d.share_limit_ppm = 1'600'000;
    d.share_slack_ns = 10'000'000;
    d.plan_slack_ns = draw.upto(20'000'000);
    for (int i = 0; i < abi::kTaskWords; ++i) {
        const auto bits = [&] {
            return static_cast<std::uint64_t>(draw.upto(INT64_MAX) & draw.upto(INT64_MAX));
        };
        d.given_up[i] = bits();
        d.late_first[i] = bits();
        d.may_share[i] = bits();
    }
    for (int task = 0; task < num_tasks; ++task) {
        draw_slot(page.tasks[task], draw, task);
        if (!draw.one_in(5)) page.active[task / 64] |= std::uint64_t{1} << (task % 64);
    }
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
