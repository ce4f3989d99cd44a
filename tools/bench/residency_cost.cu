// SPDX-License-Identifier: Apache-2.0
//
// What a dispatcher on the GPU costs the work beside it (residency_cost.py loads this library): the
// dispatcher's own kernels over a page of two tasks whose gates never open, and work to be timed.
// In the primary context, which the caller's frameworks have, too.
//
// All functions are for one thread, and return CUDA's error (0: none).
#include <cuda.h>
#include <cuda_runtime.h>
#include <sched.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <new>
#include <thread>

#include "device/dispatcher.cu"
#include "device/marks.cu"

#define TRY(call)                                                         \
    do {                                                                  \
        if (const cudaError_t error_of_try = (call)) return error_of_try; \
    } while (false)

namespace {

constexpr int kTasks = 2, kThreads = 256, kLeasesAhead = 3, kArmsAhead = 16;
constexpr std::uint64_t kIdle_ns = 200'000;
constexpr std::size_t kFloats = 64u << 20;

struct State {
    abi::SharedPage* page = nullptr;
    abi::DispatchLease* lease = nullptr;
    std::uint64_t* line = nullptr;  // of marks
    DispatchArgs args{};
    cudaStream_t work = nullptr, leases = nullptr;
    cudaEvent_t begin = nullptr, end = nullptr;
    float *d_in = nullptr, *d_out = nullptr;
    int num_sms = 0, threads_of_sm = 0, shared_bytes = 0;
    std::uint64_t marks = 0;
    std::thread extends;
    std::atomic<bool> stop{false};
    std::atomic<std::uint32_t> launched{0};  // leases
    std::atomic<std::uint32_t> armed{0};     // arms
    decltype(&cuStreamWaitValue32) wait_value = nullptr;
    std::chrono::steady_clock::time_point since;
    std::uint32_t ended_before = 0;
} s;

__global__ void memory_work(float* out, const float* in, std::size_t size) {
    const std::size_t stride = std::size_t{gridDim.x} * blockDim.x;
    for (std::size_t i = std::size_t{blockIdx.x} * blockDim.x + threadIdx.x; i < size; i += stride)
        out[i] = in[i] + 1;
}

/// As long as it is told to, and no shorter beside others.
__global__ void compute_work(float* never_written, int iterations) {
    float a = threadIdx.x * 1e-3f, b = a + 1, c = a + 2, d = a + 3;
    for (int i = 0; i < iterations; ++i) {
        a = __fmaf_rn(a, 1.000001f, 1e-7f);
        b = __fmaf_rn(b, 1.000001f, 1e-7f);
        c = __fmaf_rn(c, 1.000001f, 1e-7f);
        d = __fmaf_rn(d, 1.000001f, 1e-7f);
    }
    if (a + b + c + d == -123.456f) *never_written = a;
}

/// A gate that nothing opens: what is before it has not been launched, and its time does not come.
void close_for_ever(abi::TaskSlot& slot, std::int64_t now_ns, int task) {
    slot.version = 2;
    slot.state = abi::TaskState::kGpu;
    slot.deadline_ns = now_ns + 3'600'000'000'000 + task;
    slot.period_ns = slot.relative_deadline_ns = 100'000'000;
    slot.launch_ns = slot.look_ns = slot.progress_ns = now_ns;
    slot.head_utilization_ppm = 1'000'000;
    slot.head_remaining_ns = 1'000'000'000;
    slot.launched_ns = 2'000'000'000;
    slot.is_supported = 1;
    slot.gate_by_ns = std::numeric_limits<std::int64_t>::max();
    slot.gates_closed = 1;
    slot.group_begin_ns[1] = 1'000'000'000;
    slot.group_time_ns[1] = 1'000'000;
    slot.group_utilization_ppm[1] = 1'000'000;
}

cudaError_t make_page() {
    char* memory = nullptr;
    const std::size_t bytes = sizeof(abi::SharedPage) + sizeof(abi::DispatchLease) + 64;
    TRY(cudaHostAlloc(reinterpret_cast<void**>(&memory), bytes, cudaHostAllocMapped));
    s.page = new (memory) abi::SharedPage();
    s.lease = new (memory + sizeof(abi::SharedPage)) abi::DispatchLease();
    s.line = reinterpret_cast<std::uint64_t*>(memory + bytes - 64);
    // %globaltimer counts from 1970.
    const std::int64_t now_ns =
        std::chrono::duration_cast<nanoseconds>(std::chrono::system_clock::now().time_since_epoch())
            .count();
    s.page->dispatch.clock_base_ns = now_ns;
    s.page->dispatch.pack_limit_ppm = s.page->dispatch.share_limit_ppm = 1'050'000;
    s.page->dispatch.lambda = 1;
    for (int task = 0; task < kTasks; ++task) {
        close_for_ever(s.page->tasks[task], now_ns, task);
        s.page->active[0] |= std::uint64_t{1} << task;
    }
    DispatchState state{};
    for (int task = 0; task < kTasks; ++task) state.reached[task] = 1;
    DispatchState* d_state = nullptr;
    TRY(cudaMalloc(&d_state, sizeof state));
    TRY(cudaMemcpy(d_state, &state, sizeof state, cudaMemcpyHostToDevice));
    s.args = {s.page, d_state, s.lease, kTasks, 0};
    return cudaSuccess;
}

std::uint32_t ended() {
    return __atomic_load_n(&s.lease->ended, __ATOMIC_ACQUIRE);
}

void tick(std::uint32_t arm) {
    __atomic_store_n(&s.lease->ticks[arm % abi::kArmRing], arm, __ATOMIC_SEQ_CST);
}

/// Leases and arms are numbered apart. None is under way.
void begin_after(std::uint32_t last) {
    __atomic_store_n(&s.lease->ended, last, __ATOMIC_SEQ_CST);
    __atomic_store_n(&s.lease->stop, 0u, __ATOMIC_SEQ_CST);
    s.stop = false;
    s.since = std::chrono::steady_clock::now();
}

template <typename Kernel, typename... Arguments>
cudaError_t launch_mark(cudaStream_t stream, int threads, Kernel* kernel, Arguments... arguments) {
    cudaLaunchAttribute attribute{};
    attribute.id = cudaLaunchAttributeProgrammaticStreamSerialization;
    attribute.val.programmaticStreamSerializationAllowed = 1;
    cudaLaunchConfig_t config{};
    config.gridDim = 1;
    config.blockDim = static_cast<unsigned>(threads);
    config.stream = stream;
    config.attrs = &attribute;
    config.numAttrs = 1;
    return cudaLaunchKernelEx(&config, kernel, arguments...);
}

cudaError_t find_wait_value() {
    constexpr unsigned kVersion = 12000;
    cudaDriverEntryPointQueryResult found{};
    void* entry = nullptr;
    TRY(cudaGetDriverEntryPointByVersion("cuStreamWaitValue32", &entry, kVersion, cudaEnableDefault,
                                         &found));
    s.wait_value = reinterpret_cast<decltype(s.wait_value)>(entry);
    return entry ? cudaSuccess : cudaErrorNotSupported;
}

int mark_behind(cudaStream_t stream, int kind) {
    const std::uint64_t tag = ++s.marks;
    if (kind == 1) return launch_mark(stream, 1, urgengo_mark, s.line, std::uint64_t{0}, tag);
    return launch_mark(stream, kMarkThreads, kind == 2 ? urgengo_dispatch_mark : urgengo_gate_mark,
                       s.line, std::uint64_t{0}, tag, s.page, s.args.state, s.lease,
                       std::uint32_t{kTasks}, std::uint32_t{0}, std::uint32_t{1},
                       abi::MarkRanks::kForAll);
}

/// What is launched for the first time may be loaded, and waits for all that waits.
cudaError_t warm_up() {
    s.lease->stop = 1;
    urgengo_dispatch_lease<<<1, kMarkThreads, 0, s.leases>>>(s.args, 0, 0, 0);
    urgengo_dispatch_armed<<<1, kMarkThreads, 0, s.leases>>>(s.args, 0);
    for (int kind = 1; kind <= 3; ++kind) TRY(static_cast<cudaError_t>(mark_behind(s.work, kind)));
    return cudaDeviceSynchronize();
}

enum Work : int { kMemory, kCompute, kSlots, kShared };

cudaError_t launch_work(int kind, int size) {
    const unsigned full = static_cast<unsigned>(s.num_sms * s.threads_of_sm / kThreads);
    const auto compute = [&](unsigned blocks, int shared_bytes) {
        compute_work<<<blocks, kThreads, static_cast<unsigned>(shared_bytes), s.work>>>(s.d_out,
                                                                                        size);
    };
    constexpr unsigned kWaves = 20;
    constexpr int kRoomBeside = 8192;  // of shared memory, for each of the blocks
    switch (kind) {
        case kMemory:
            memory_work<<<full, kThreads, 0, s.work>>>(s.d_out, s.d_in,
                                                       kFloats / 64 * static_cast<unsigned>(size));
            break;
        case kCompute:  // half of the thread slots
            compute(kWaves * full / 2,
                    s.shared_bytes * kThreads / (s.threads_of_sm / 2) - kRoomBeside);
            break;
        case kSlots:
            compute(kWaves * full, 0);
            break;
        default:  // a block takes the multiprocessor, and there is one for each
            compute(static_cast<unsigned>(s.num_sms), s.shared_bytes);
    }
    return cudaGetLastError();
}

}  // namespace

extern "C" {

int rc_begin() {
    int least = 0, greatest = 0;
    TRY(cudaSetDevice(0));
    TRY(cudaDeviceGetAttribute(&s.num_sms, cudaDevAttrMultiProcessorCount, 0));
    TRY(cudaDeviceGetAttribute(&s.threads_of_sm, cudaDevAttrMaxThreadsPerMultiProcessor, 0));
    TRY(cudaDeviceGetAttribute(&s.shared_bytes, cudaDevAttrMaxSharedMemoryPerBlockOptin, 0));
    TRY(cudaFuncSetAttribute(compute_work, cudaFuncAttributeMaxDynamicSharedMemorySize,
                             s.shared_bytes));
    TRY(cudaDeviceGetStreamPriorityRange(&least, &greatest));
    TRY(cudaStreamCreateWithFlags(&s.work, cudaStreamNonBlocking));
    TRY(cudaStreamCreateWithPriority(&s.leases, cudaStreamNonBlocking, greatest));
    TRY(cudaEventCreate(&s.begin));
    TRY(cudaEventCreate(&s.end));
    TRY(cudaMalloc(&s.d_in, kFloats * sizeof(float)));
    TRY(cudaMalloc(&s.d_out, kFloats * sizeof(float)));
    TRY(cudaMemset(s.d_in, 0, kFloats * sizeof(float)));
    TRY(find_wait_value());
    TRY(make_page());
    return warm_up();
}

/// Resident from here on, a lease after the other, as exec/dispatcher.cpp launches them.
int rc_leases_begin(int lease_us) {
    begin_after(s.launched);
    s.ended_before = ended();
    s.extends = std::thread([lease_us] {
        cudaSetDevice(0);
        while (!s.stop) {
            while (s.launched - ended() < kLeasesAhead)
                urgengo_dispatch_lease<<<1, kMarkThreads, 0, s.leases>>>(
                    s.args, ++s.launched, std::uint64_t{1000} * lease_us, kIdle_ns);
            std::this_thread::sleep_for(std::chrono::microseconds(lease_us / 4));
        }
    });
    return cudaGetLastError();
}

/// @param[out] leases  that have ended by themselves
/// @param[out] us      since they began
int rc_leases_end(int* leases, double* us) {
    *us = std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - s.since)
              .count();
    *leases = static_cast<int>(ended() - s.ended_before);
    s.stop = true;
    s.extends.join();
    __atomic_store_n(&s.lease->stop, 1u, __ATOMIC_SEQ_CST);
    return cudaStreamSynchronize(s.leases);
}

/// From here on arms wait, as exec/dispatcher.cpp puts them there.
int rc_arms_begin() {
    begin_after(s.armed);
    s.extends = std::thread([] {
        cudaSetDevice(0);
        while (!s.stop) {
            while (s.armed - ended() < kArmsAhead) {
                const std::uint32_t arm = ++s.armed;
                const auto word =
                    reinterpret_cast<CUdeviceptr>(&s.lease->ticks[arm % abi::kArmRing]);
                s.wait_value(s.leases, word, arm, CU_STREAM_WAIT_VALUE_GEQ);
                urgengo_dispatch_armed<<<1, kMarkThreads, 0, s.leases>>>(s.args, arm);
            }
            std::this_thread::sleep_for(std::chrono::microseconds(200));
        }
    });
    return cudaGetLastError();
}

int rc_arms_end() {
    s.stop = true;
    s.extends.join();
    __atomic_store_n(&s.lease->stop, 1u, __ATOMIC_SEQ_CST);
    for (std::uint32_t arm = ended() + 1; arm <= s.armed; ++arm) tick(arm);
    return cudaStreamSynchronize(s.leases);
}

/// A mark behind what is on the stream. @param kind  1: plain, 2: runs a round, 3: wakes an arm
int rc_mark(void* stream, int kind) {
    return mark_behind(static_cast<cudaStream_t>(stream), kind);
}

/// @param marks       0: none, or a kind of marks
/// @param mark_every  launches
/// @param[out] ms     on the GPU, of all launches
int rc_work(int kind, int size, int launches, int marks, int mark_every, float* ms) {
    TRY(cudaEventRecord(s.begin, s.work));
    for (int i = 1; i <= launches; ++i) {
        TRY(launch_work(kind, size));
        if (marks != 0 && i % mark_every == 0)
            TRY(static_cast<cudaError_t>(rc_mark(s.work, marks)));
    }
    TRY(cudaEventRecord(s.end, s.work));
    TRY(cudaEventSynchronize(s.end));
    return cudaEventElapsedTime(ms, s.begin, s.end);
}

/// @returns gates that have opened, though none should have; and the rounds of the GPU
int rc_opened(int* rounds) {
    *rounds = static_cast<int>(s.page->dispatch.gpu_rounds.load());
    int opened = 0;
    for (int task = 0; task < kTasks; ++task)
        opened += static_cast<int>(s.page->tasks[task].gates_opened.load());
    return opened;
}

}  // extern "C"
