// SPDX-License-Identifier: Apache-2.0
//
// How long after more urgent work has ended does work that waited for it begin? Two threads, named
// `urgent` and `loose`, launch a kernel each in every round, the loose one while the urgent one's
// fills the GPU. By %globaltimer: from the last block's last instruction to the first block's
// first.
//
//   release_latency ROUNDS
//
// One line: the latencies in ns, of rounds in which the loose kernel was launched before the urgent
// one ended and began behind it. Exit status 2 if CUDA fails.
//
//   release_latency ROUNDS blocking|alone
//
// How much work of the loose thread's is in the way of an urgent kernel that is released meanwhile?
// The loose thread launches kFrame kernels a round, the urgent one a single kernel at some time
// while they execute. One line: how long it took from before its launch until its thread knew that
// it had executed, less what it executed for, in ns; with `alone` the loose thread launches
// nothing.
#include <cuda_runtime.h>
#include <pthread.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::microseconds;

constexpr microseconds kPeriod{8000}, kLater{500};
constexpr std::uint64_t kUrgent_ns = 2'000'000, kLoose_ns = 300'000;
constexpr int kThreads = 1024, kWarmUp = 25;
// Blocking: a frame of the loose thread, and when after its begin the urgent one's kernel comes.
constexpr int kFrame = 16;
constexpr microseconds kComes{1000}, kVaries{2500}, kStep{137};

#define MUST(call) must((call), #call)
void must(cudaError_t result, const char* call) {
    if (result == cudaSuccess) return;
    std::printf("%s: %s\n", call, cudaGetErrorString(result));
    std::exit(2);
}

__device__ std::uint64_t gpu_time() {
    std::uint64_t ns;
    asm volatile("mov.u64 %0, %globaltimer;" : "=l"(ns));
    return ns;
}

struct Times {
    unsigned long long begin = UINT64_MAX, end = 0;
};

__device__ void take_time(Times* times, std::uint64_t ns) {
    const std::uint64_t begin = gpu_time();
    if (threadIdx.x == 0) atomicMin(&times->begin, begin);
    while (gpu_time() - begin < ns) {
    }
    __syncthreads();
    if (threadIdx.x == 0) atomicMax(&times->end, gpu_time());
}

__global__ void __launch_bounds__(kThreads) urgent_work(Times* times, std::uint64_t ns) {
    take_time(times, ns);
}
__global__ void __launch_bounds__(kThreads) loose_work(Times* times, std::uint64_t ns) {
    take_time(times, ns);
}

int blocks_that_fit() {
    int of_sm = 0;
    cudaDeviceProp properties{};
    MUST(cudaGetDeviceProperties(&properties, 0));
    MUST(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&of_sm, urgent_work, kThreads, 0));
    return of_sm * properties.multiProcessorCount;
}

using Kernel = void (*)(Times*, std::uint64_t);

struct Launches {
    const char* thread;
    Kernel kernel;
    std::uint64_t ns;  ///< a kernel's
    int in_round = 1;
    bool varies = false;  ///< when a round begins, by up to kVaries
};

/// @returns what each round took, until its thread knew that it had executed
std::vector<Clock::duration> launch_each_period(const Launches& its, int num_blocks, Times* times,
                                                int num_rounds, Clock::time_point first) {
    pthread_setname_np(pthread_self(), its.thread);
    cudaStream_t stream = nullptr;
    MUST(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking));
    std::vector<Clock::duration> took;
    for (int i = 0; i < num_rounds; ++i) {
        const auto later = its.varies ? i * kStep % kVaries : microseconds{0};
        std::this_thread::sleep_until(first + i * kPeriod + later);
        const auto begin = Clock::now();
        for (int k = 0; k < its.in_round; ++k)
            its.kernel<<<num_blocks, kThreads, 0, stream>>>(times + i, its.ns);
        MUST(cudaGetLastError());
        MUST(cudaStreamSynchronize(stream));
        took.push_back(Clock::now() - begin);
    }
    return took;
}

void print_blocking(int num_blocks, Times* d_urgent, Times* d_loose, int num_rounds,
                    bool is_alone) {
    const auto first = Clock::now() + kPeriod;
    std::thread loose;
    if (!is_alone)
        loose = std::thread(launch_each_period, Launches{"loose", loose_work, kLoose_ns, kFrame},
                            num_blocks, d_loose, num_rounds, first);
    std::vector<Clock::duration> took;
    std::thread([&] {
        took = launch_each_period({"urgent", urgent_work, kLoose_ns, 1, true}, num_blocks, d_urgent,
                                  num_rounds, first + kComes);
    }).join();
    if (loose.joinable()) loose.join();
    std::vector<Times> urgent(num_rounds);
    MUST(cudaMemcpy(urgent.data(), d_urgent, num_rounds * sizeof(Times), cudaMemcpyDeviceToHost));
    for (int i = kWarmUp; i < num_rounds; ++i) {
        const auto executed = static_cast<std::int64_t>(urgent[i].end - urgent[i].begin);
        const auto all = std::chrono::nanoseconds(took[i]).count();
        std::printf("%lld ", static_cast<long long>(std::max<std::int64_t>(all - executed, 0)));
    }
    std::printf("\n");
}

}  // namespace

int main(int argc, char** argv) {
    const int num_rounds = kWarmUp + (argc > 1 ? std::atoi(argv[1]) : 100);
    const int num_blocks = blocks_that_fit();
    Times *d_urgent = nullptr, *d_loose = nullptr;
    std::vector<Times> urgent(num_rounds), loose(num_rounds);
    const std::size_t bytes = num_rounds * sizeof(Times);
    for (auto [d_times, times] : {std::pair{&d_urgent, &urgent}, std::pair{&d_loose, &loose}}) {
        MUST(cudaMalloc(d_times, bytes));
        MUST(cudaMemcpy(*d_times, times->data(), bytes, cudaMemcpyHostToDevice));
    }
    if (argc > 2) {
        print_blocking(num_blocks, d_urgent, d_loose, num_rounds,
                       argv[2] == std::string_view("alone"));
        return 0;
    }
    const auto first = Clock::now() + kPeriod;
    std::thread other(launch_each_period, Launches{"urgent", urgent_work, kUrgent_ns}, num_blocks,
                      d_urgent, num_rounds, first);
    std::thread waits(launch_each_period, Launches{"loose", loose_work, kLoose_ns}, num_blocks,
                      d_loose, num_rounds, first + kLater);
    other.join();
    waits.join();
    MUST(cudaMemcpy(urgent.data(), d_urgent, bytes, cudaMemcpyDeviceToHost));
    MUST(cudaMemcpy(loose.data(), d_loose, bytes, cudaMemcpyDeviceToHost));
    for (int i = kWarmUp; i < num_rounds; ++i)
        if (loose[i].begin > urgent[i].end && loose[i].begin < urgent[i].end + 4'000'000)
            std::printf("%llu ", loose[i].begin - urgent[i].end);
    std::printf("\n");
    return 0;
}
