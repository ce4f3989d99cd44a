// SPDX-License-Identifier: Apache-2.0
//
// A libcupti for the simulated GPU: those entry points that UrgenGo uses, with the simulated GPU's
// own log behind them. FAKE_CUPTI says what goes wrong, any of: "refused" (another tool has it),
// "drops" (every fifth kernel's record is lost), "forgets" (the same, and it is not counted),
// "untimed" (every fifth record has no times),
// "shuffles" (records come last first), "runtime" (kernels carry the id of the runtime's call).
#include <cupti.h>
#include <dlfcn.h>
#include <time.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <utility>
#include <vector>

#include "tools/simgpu/simgpu.h"

#define FAKE extern "C" __attribute__((visibility("default"))) CUptiResult CUPTIAPI

namespace {

using KernelRecord = CUpti_ActivityKernel9;

constexpr std::uint64_t kAhead = 500'000'000'000'000'000;
constexpr std::uint32_t kRuntimeIds = 1u << 24;  ///< the runtime's ids are this much larger

std::mutex g_mutex;
CUpti_CallbackFunc g_callback = nullptr;
CUpti_BuffersCallbackRequestFunc g_give = nullptr;
CUpti_BuffersCallbackCompleteFunc g_take = nullptr;
bool g_enabled = false, g_records = false;
std::size_t g_seen = 0, g_dropped = 0;

bool asks(const char* what) {
    const char* value = std::getenv("FAKE_CUPTI");
    return value && std::strstr(value, what);
}

void* driver() {
    const char* path = std::getenv("TWIN_SIMGPU");
    return path ? dlopen(path, RTLD_NOW | RTLD_NOLOAD) : nullptr;
}

void call(CUpti_CallbackDomain domain, CUpti_CallbackId id, bool begins, std::uint32_t launch) {
    CUpti_CallbackData data{};
    data.callbackSite = begins ? CUPTI_API_ENTER : CUPTI_API_EXIT;
    data.correlationId = launch;
    g_callback(nullptr, domain, id, &data);
}

void on_launch(std::uint64_t launch, int begins) {
    if (!g_enabled) return;
    const auto id = static_cast<std::uint32_t>(launch);
    // What the driver is called for by the runtime is known by the runtime's call alone.
    if (asks("runtime")) {
        if (begins)
            call(CUPTI_CB_DOMAIN_RUNTIME_API, CUPTI_RUNTIME_TRACE_CBID_cudaLaunchKernel_v7000, true,
                 id + kRuntimeIds);
        return;
    }
    call(CUPTI_CB_DOMAIN_DRIVER_API, CUPTI_DRIVER_TRACE_CBID_cuLaunchKernel, begins, id);
}

std::vector<simgpu_kernel_record> new_kernels() {
    const auto read =
        reinterpret_cast<decltype(&simgpu_kernel_log)>(dlsym(driver(), "simgpu_kernel_log"));
    std::vector<simgpu_kernel_record> kernels(1 << 16);
    kernels.resize(std::min(read(kernels.data(), kernels.size()), kernels.size()));
    const std::size_t known = std::min(g_seen, kernels.size());
    g_seen = kernels.size();
    kernels.erase(kernels.begin(), kernels.begin() + static_cast<std::ptrdiff_t>(known));
    if (asks("drops") || asks("forgets")) {
        std::size_t number = known;
        const std::size_t before = kernels.size();
        std::erase_if(kernels, [&](const auto&) { return number++ % 5 == 0; });
        if (asks("drops")) g_dropped += before - kernels.size();
    }
    if (asks("shuffles")) std::reverse(kernels.begin(), kernels.end());
    return kernels;
}

void fill(KernelRecord& record, const simgpu_kernel_record& kernel) {
    static auto& names = *new std::vector<char*>;  // for good
    names.push_back(strdup(kernel.name));
    record = {};
    record.kind = CUPTI_ACTIVITY_KIND_CONCURRENT_KERNEL;
    static std::size_t filled = 0;
    if (!asks("untimed") || filled++ % 5 != 0) {
        record.start = static_cast<std::uint64_t>(kernel.start_ns) + kAhead;
        record.end = static_cast<std::uint64_t>(kernel.end_ns) + kAhead;
    }
    record.gridX = static_cast<std::int32_t>(kernel.num_blocks);
    record.gridY = record.gridZ = record.blockX = record.blockY = record.blockZ = 1;
    record.correlationId =
        static_cast<std::uint32_t>(kernel.launch) + (asks("runtime") ? kRuntimeIds : 0);
    record.streamId = static_cast<std::uint32_t>(kernel.stream_id);
    record.name = names.back();
}

}  // namespace

FAKE cuptiSubscribe(CUpti_SubscriberHandle* subscriber, CUpti_CallbackFunc callback, void*) {
    if (asks("refused")) return CUPTI_ERROR_MULTIPLE_SUBSCRIBERS_NOT_SUPPORTED;
    void* const library = driver();
    const auto set_hook = reinterpret_cast<decltype(&simgpu_set_launch_hook)>(
        library ? dlsym(library, "simgpu_set_launch_hook") : nullptr);
    if (!set_hook) return CUPTI_ERROR_NOT_INITIALIZED;
    g_callback = callback;
    set_hook(on_launch);
    *subscriber = nullptr;
    return CUPTI_SUCCESS;
}

FAKE cuptiEnableCallback(std::uint32_t enable, CUpti_SubscriberHandle, CUpti_CallbackDomain,
                         CUpti_CallbackId) {
    g_enabled = enable != 0;
    return CUPTI_SUCCESS;
}

FAKE cuptiActivityRegisterCallbacks(CUpti_BuffersCallbackRequestFunc give,
                                    CUpti_BuffersCallbackCompleteFunc take) {
    g_give = give, g_take = take;
    return CUPTI_SUCCESS;
}

FAKE cuptiActivityEnable(CUpti_ActivityKind kind) {
    // The other kind has kernels run one after the other.
    g_records = kind == CUPTI_ACTIVITY_KIND_CONCURRENT_KERNEL;
    return g_records ? CUPTI_SUCCESS : CUPTI_ERROR_INVALID_KIND;
}

FAKE cuptiActivityGetNextRecord(std::uint8_t* buffer, std::size_t bytes, CUpti_Activity** record) {
    auto* next = *record ? reinterpret_cast<std::uint8_t*>(*record) + sizeof(KernelRecord) : buffer;
    if (next + sizeof(KernelRecord) > buffer + bytes) return CUPTI_ERROR_MAX_LIMIT_REACHED;
    *record = reinterpret_cast<CUpti_Activity*>(next);
    return CUPTI_SUCCESS;
}

FAKE cuptiActivityGetNumDroppedRecords(CUcontext, std::uint32_t, std::size_t* dropped) {
    *dropped = std::exchange(g_dropped, 0);
    return CUPTI_SUCCESS;
}

FAKE cuptiActivityFlushAll(std::uint32_t) {
    const std::lock_guard lock(g_mutex);
    if (!g_records) return CUPTI_ERROR_INVALID_OPERATION;
    const auto kernels = new_kernels();
    for (std::size_t done = 0; done < kernels.size();) {
        std::uint8_t* buffer = nullptr;
        std::size_t bytes = 0, most = 0, used = 0;
        g_give(&buffer, &bytes, &most);
        if (!buffer) return CUPTI_ERROR_OUT_OF_MEMORY;
        for (; done < kernels.size() && used + sizeof(KernelRecord) <= bytes;
             used += sizeof(KernelRecord)) {
            KernelRecord record;
            fill(record, kernels[done++]);
            std::memcpy(buffer + used, &record, sizeof record);
        }
        g_take(nullptr, 0, buffer, bytes, used);
    }
    return CUPTI_SUCCESS;
}

FAKE cuptiGetTimestamp(std::uint64_t* time) {
    timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    *time = static_cast<std::uint64_t>(now.tv_sec) * 1'000'000'000 +
            static_cast<std::uint64_t>(now.tv_nsec) + kAhead;
    return CUPTI_SUCCESS;
}

FAKE cuptiGetResultString(CUptiResult result, const char** text) {
    *text = result == CUPTI_ERROR_NOT_INITIALIZED ? "CUPTI_ERROR_NOT_INITIALIZED" : "CUPTI_ERROR";
    return CUPTI_SUCCESS;
}
