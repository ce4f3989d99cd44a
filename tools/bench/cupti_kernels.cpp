// SPDX-License-Identifier: Apache-2.0
//
// Writes down when every kernel of a program began and ended, as CUPTI saw it, and by which thread
// it was launched. Loaded by the driver (CUDA_INJECTION64_PATH), with UrgenGo or without; built by
// cupti_library.py. CUPTI_KERNELS names the file; its lines, in no order:
//
//   kernel STREAM CORRELATION BEGIN END NAME    of CUPTI's clock
//   launch CORRELATION THREAD TIME              the driver's call began, CLOCK_MONOTONIC
//   thread THREAD NAME                          as it was named at its first launch
//   clock CUPTI MONOTONIC                       the same moment, to within a microsecond
//   dropped COUNT                               records that CUPTI has lost
//
// Launches are told if CUPTI_LAUNCHES is set.
#include <cupti.h>
#include <sys/prctl.h>
#include <time.h>
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <mutex>
#include <string>
#include <vector>

namespace {

constexpr std::size_t kBufferBytes = 4 << 20;
constexpr std::size_t kBufferAlignment = 8;
constexpr int kClockTries = 20;
constexpr CUpti_CallbackId kLaunchCalls[] = {
    CUPTI_DRIVER_TRACE_CBID_cuLaunchKernel, CUPTI_DRIVER_TRACE_CBID_cuLaunchKernel_ptsz,
    CUPTI_DRIVER_TRACE_CBID_cuLaunchKernelEx, CUPTI_DRIVER_TRACE_CBID_cuLaunchKernelEx_ptsz};

struct Launch {
    std::uint32_t correlation;
    std::uint64_t time_ns;
};
/// Written by its thread alone, and read at exit, when there is none but the main one.
struct Thread {
    int id;
    std::string name;
    std::vector<Launch> launches;
};

std::FILE* out = nullptr;
std::mutex mutex;  // guards `out` and `threads`
std::vector<Thread*> threads;

bool succeeded(CUptiResult result, const char* what) {
    if (result == CUPTI_SUCCESS) return true;
    const char* text = "no description";
    cuptiGetResultString(result, &text);
    std::fprintf(stderr, "cupti_kernels: %s: %s\n", what, text);
    return false;
}

void CUPTIAPI give_buffer(std::uint8_t** buffer, std::size_t* size, std::size_t* max_records) {
    *size = kBufferBytes;
    *max_records = 0;
    *buffer = static_cast<std::uint8_t*>(std::aligned_alloc(kBufferAlignment, kBufferBytes));
}

std::uint64_t monotonic_ns() {
    timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return static_cast<std::uint64_t>(now.tv_sec) * 1'000'000'000 +
           static_cast<std::uint64_t>(now.tv_nsec);
}

/// The two readings that lie closest together, of a few.
void write_clock() {
    std::uint64_t theirs = 0, ours = 0, least = std::numeric_limits<std::uint64_t>::max();
    for (int i = 0; i < kClockTries; ++i) {
        std::uint64_t time = 0;
        const std::uint64_t before = monotonic_ns();
        if (cuptiGetTimestamp(&time) != CUPTI_SUCCESS) return;
        const std::uint64_t took = monotonic_ns() - before;
        if (took >= least) continue;
        least = took, theirs = time, ours = before + took / 2;
    }
    std::fprintf(out, "clock %llu %llu\n", static_cast<unsigned long long>(theirs),
                 static_cast<unsigned long long>(ours));
}

Thread& this_thread() {
    static thread_local Thread* thread = nullptr;
    if (thread) return *thread;
    char name[16] = {};
    prctl(PR_GET_NAME, name);
    thread = new Thread{gettid(), name, {}};
    thread->launches.reserve(1 << 14);
    const std::lock_guard lock(mutex);
    threads.push_back(thread);
    return *thread;
}

void CUPTIAPI on_call(void*, CUpti_CallbackDomain, CUpti_CallbackId, const void* data) {
    const auto& call = *static_cast<const CUpti_CallbackData*>(data);
    if (call.callbackSite != CUPTI_API_ENTER) return;
    this_thread().launches.push_back({call.correlationId, monotonic_ns()});
}

bool listen_to_launches() {
    CUpti_SubscriberHandle subscriber = nullptr;
    if (!succeeded(cuptiSubscribe(&subscriber, on_call, nullptr), "subscribe")) return false;
    for (const CUpti_CallbackId call : kLaunchCalls)
        if (!succeeded(cuptiEnableCallback(1, subscriber, CUPTI_CB_DOMAIN_DRIVER_API, call),
                       "callback"))
            return false;
    return true;
}

void write_launches() {
    for (const Thread* thread : threads) {
        std::fprintf(out, "thread %d %s\n", thread->id, thread->name.c_str());
        for (const Launch& launch : thread->launches)
            std::fprintf(out, "launch %u %d %llu\n", launch.correlation, thread->id,
                         static_cast<unsigned long long>(launch.time_ns));
    }
}

void write(const CUpti_ActivityKernel9& kernel) {
    std::fprintf(out, "kernel %u %u %llu %llu %s\n", kernel.streamId, kernel.correlationId,
                 static_cast<unsigned long long>(kernel.start),
                 static_cast<unsigned long long>(kernel.end), kernel.name);
}

void CUPTIAPI take_buffer(CUcontext context, std::uint32_t stream, std::uint8_t* buffer,
                          std::size_t, std::size_t valid_bytes) {
    const std::lock_guard lock(mutex);
    CUpti_Activity* record = nullptr;
    while (out && cuptiActivityGetNextRecord(buffer, valid_bytes, &record) == CUPTI_SUCCESS) {
        if (record->kind != CUPTI_ACTIVITY_KIND_CONCURRENT_KERNEL) continue;
        // Later versions of the record only add to its end.
        CUpti_ActivityKernel9 kernel;
        std::memcpy(&kernel, record, sizeof(kernel));
        write(kernel);
    }
    std::size_t dropped = 0;
    cuptiActivityGetNumDroppedRecords(context, stream, &dropped);
    if (dropped && out) std::fprintf(out, "dropped %zu\n", dropped);
    std::free(buffer);
}

void finish() {
    succeeded(cuptiActivityFlushAll(CUPTI_ACTIVITY_FLAG_FLUSH_FORCED), "flush");
    const std::lock_guard lock(mutex);
    if (!out) return;
    write_launches();
    write_clock();
    if (std::fclose(out) != 0) std::perror("cupti_kernels: cannot write the file");
    out = nullptr;
}

}  // namespace

/// Called by the driver when it starts. @returns 1
extern "C" int InitializeInjection() {
    const char* path = std::getenv("CUPTI_KERNELS");
    out = path ? std::fopen(path, "w") : nullptr;
    if (!out) {
        std::perror("cupti_kernels: cannot write what CUPTI_KERNELS names");
        return 1;
    }
    write_clock();
    if (std::getenv("CUPTI_LAUNCHES") && !listen_to_launches()) return 1;
    if (succeeded(cuptiActivityRegisterCallbacks(give_buffer, take_buffer), "callbacks") &&
        succeeded(cuptiActivityEnable(CUPTI_ACTIVITY_KIND_CONCURRENT_KERNEL), "kernels"))
        std::atexit(finish);
    return 1;
}
