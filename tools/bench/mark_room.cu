// SPDX-License-Identifier: Apache-2.0
//
// When does a small kernel begin beside one that is on every multiprocessor and leaves it thread
// slots? mark_room.py loads this library. Small kernels are UrgenGo's marks, with so many threads,
// and one with shared memory, as the dispatcher's kernels had until 2026-11-26.
//
// All functions are for one thread, and return CUDA's error (0: none).
#include <cuda_runtime.h>

#include <chrono>
#include <cstdint>
#include <thread>

#include "device/dispatcher.cu"
#include "device/marks.cu"

#define TRY(call)                                                         \
    do {                                                                  \
        if (const cudaError_t error_of_try = (call)) return error_of_try; \
    } while (false)

namespace {

using Clock = std::chrono::steady_clock;
constexpr std::uint64_t kBeside_ns = 1'500'000;
constexpr std::chrono::milliseconds kPatience{100};
constexpr int kSharedBytes = 6256, kMostShared_bytes = 200 << 10;

struct State {
    std::uint64_t* line = nullptr;  // of marks
    std::uint32_t* began = nullptr;
    DispatchState* d_state = nullptr;
    cudaStream_t beside = nullptr, marked = nullptr;
    cudaEvent_t begin = nullptr, end = nullptr;
    int num_sms = 0;
    std::uint64_t sequence = 0;
} s;

__global__ void spin(std::uint32_t* began, std::uint64_t duration_ns) {
    if (began && blockIdx.x == 0 && threadIdx.x == 0)
        in_system(*began).store(1, cuda::memory_order_release);
    const std::uint64_t begin_ns = globaltimer_ns();
    while (globaltimer_ns() - begin_ns < duration_ns) {
    }
}

__global__ void mark_with_shared(std::uint64_t* line, std::uint64_t word0, std::uint64_t tag) {
    __shared__ volatile char bytes[kSharedBytes];
    bytes[threadIdx.x] = 1;
    __syncthreads();
    if (threadIdx.x == 0 && bytes[0] != 0) {
        in_system(line[0]).store(word0, cuda::memory_order_relaxed);
        in_system(line[1]).store(tag, cuda::memory_order_release);
    }
}

enum Kind : int { kMark, kGateMark, kWithShared };

cudaError_t launch(cudaStream_t stream, int kind, int threads) {
    const std::uint64_t number = ++s.sequence;
    constexpr std::uint64_t kNoTag = 0;
    if (kind == kMark)
        urgengo_mark<<<1, threads, 0, stream>>>(s.line, number, kNoTag);
    else if (kind == kGateMark)
        urgengo_gate_mark<<<1, threads, 0, stream>>>(s.line, number, kNoTag, nullptr, s.d_state,
                                                     nullptr, 1, 0, 0, abi::MarkRanks::kNever);
    else
        mark_with_shared<<<1, threads, 0, stream>>>(s.line, number, kNoTag);
    return cudaGetLastError();
}

bool has_run() {
    return __atomic_load_n(&s.line[0], __ATOMIC_ACQUIRE) == s.sequence;
}

}  // namespace

extern "C" {

int mr_begin() {
    int least = 0, greatest = 0;
    TRY(cudaSetDevice(0));
    TRY(cudaDeviceGetAttribute(&s.num_sms, cudaDevAttrMultiProcessorCount, 0));
    TRY(cudaDeviceGetStreamPriorityRange(&least, &greatest));
    TRY(cudaStreamCreateWithFlags(&s.beside, cudaStreamNonBlocking));
    TRY(cudaStreamCreateWithPriority(&s.marked, cudaStreamNonBlocking, greatest));
    TRY(cudaEventCreate(&s.begin));
    TRY(cudaEventCreate(&s.end));
    TRY(cudaHostAlloc(reinterpret_cast<void**>(&s.line), 128, cudaHostAllocMapped));
    s.began = reinterpret_cast<std::uint32_t*>(s.line + 8);
    TRY(cudaMalloc(&s.d_state, sizeof *s.d_state));
    TRY(cudaMemset(s.d_state, 0, sizeof *s.d_state));
    TRY(cudaFuncSetAttribute(spin, cudaFuncAttributeMaxDynamicSharedMemorySize, kMostShared_bytes));
    spin<<<1, 1, 0, s.beside>>>(nullptr, 0);
    for (const int kind : {kMark, kGateMark, kWithShared}) TRY(launch(s.marked, kind, 32));
    return cudaDeviceSynchronize();
}

/// @param threads, blocks, shared_bytes  of the kernel that is on every multiprocessor: of a block,
///                                       a multiprocessor, a block
/// @param[out] us  from the launch of the small kernel until the host sees what it wrote
int mr_wait(int threads, int blocks, int shared_bytes, int kind, int small_threads, double* us) {
    __atomic_store_n(s.began, 0, __ATOMIC_SEQ_CST);
    spin<<<s.num_sms * blocks, threads, shared_bytes, s.beside>>>(s.began, kBeside_ns);
    TRY(cudaGetLastError());
    const auto launched = Clock::now();
    while (__atomic_load_n(s.began, __ATOMIC_ACQUIRE) == 0 && Clock::now() - launched < kPatience) {
    }
    std::this_thread::sleep_for(std::chrono::microseconds(200));  // all of its blocks are there
    const auto begin = Clock::now();
    TRY(launch(s.marked, kind, small_threads));
    while (!has_run() && Clock::now() - begin < kPatience) {
    }
    *us = std::chrono::duration<double, std::micro>(Clock::now() - begin).count();
    return cudaDeviceSynchronize();
}

/// @param small_threads  0: no marks
/// @param[out] us        on the GPU, of so many kernels of 20 us, each with a mark behind it
int mr_chain(int kernels, int small_threads, double* us) {
    constexpr std::uint64_t kKernel_ns = 20'000;
    float ms = 0;
    // What is launched behind it is there when it ends: the GPU waits for no launch.
    spin<<<1, 1, 0, s.marked>>>(nullptr, 10 * kernels * kKernel_ns / 20);
    TRY(cudaEventRecord(s.begin, s.marked));
    for (int i = 0; i < kernels; ++i) {
        spin<<<s.num_sms, 256, 0, s.marked>>>(nullptr, kKernel_ns);
        TRY(cudaGetLastError());
        if (small_threads > 0) TRY(launch(s.marked, kMark, small_threads));
    }
    TRY(cudaEventRecord(s.end, s.marked));
    TRY(cudaEventSynchronize(s.end));
    TRY(cudaEventElapsedTime(&ms, s.begin, s.end));
    *us = 1000.0 * ms;
    return cudaSuccess;
}

}  // extern "C"
