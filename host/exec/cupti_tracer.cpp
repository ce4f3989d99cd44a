// SPDX-License-Identifier: Apache-2.0
#include "host/exec/cupti_tracer.h"

#if __has_include(<cupti.h>)
#include <cupti.h>
#include <dlfcn.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <string_view>

#include "host/base/mapped_libraries.h"
#include "host/exec/cupti_library.h"

namespace urgengo::exec {
namespace {

using abi::TraceKind;
using abi::TraceRecord;

/// As small as it may be, as what a program leaves in them that is killed is lost.
constexpr std::size_t kBufferBytes = 256 << 10;
constexpr std::size_t kBufferAlignment = 8;
constexpr nanoseconds kFlushEvery = std::chrono::milliseconds(250);
/// How often a pair of clocks is read: the pair that took the shortest counts.
constexpr int kClockTries = 5;
/// What our own kernels are called (device/marks.cu).
constexpr std::string_view kOwnKernels = "urgengo_";

/// Older libraries make shorter records, newer ones add to the end: what is used is in all.
using KernelActivity = CUpti_ActivityKernel4;

__attribute__((tls_model("initial-exec"))) thread_local std::uint32_t t_driver_id = 0;
__attribute__((tls_model("initial-exec"))) thread_local std::uint32_t t_runtime_id = 0;

constexpr CUpti_CallbackId kDriverCalls[] = {
    CUPTI_DRIVER_TRACE_CBID_cuLaunch,
    CUPTI_DRIVER_TRACE_CBID_cuLaunchGrid,
    CUPTI_DRIVER_TRACE_CBID_cuLaunchGridAsync,
    CUPTI_DRIVER_TRACE_CBID_cuLaunchKernel,
    CUPTI_DRIVER_TRACE_CBID_cuLaunchKernel_ptsz,
    CUPTI_DRIVER_TRACE_CBID_cuLaunchKernelEx,
    CUPTI_DRIVER_TRACE_CBID_cuLaunchKernelEx_ptsz,
    CUPTI_DRIVER_TRACE_CBID_cuLaunchCooperativeKernel,
    CUPTI_DRIVER_TRACE_CBID_cuLaunchCooperativeKernel_ptsz,
    CUPTI_DRIVER_TRACE_CBID_cuGraphLaunch,
    CUPTI_DRIVER_TRACE_CBID_cuGraphLaunch_ptsz,
};
constexpr CUpti_CallbackId kRuntimeCalls[] = {
    CUPTI_RUNTIME_TRACE_CBID_cudaLaunchKernel_v7000,
    CUPTI_RUNTIME_TRACE_CBID_cudaLaunchKernel_ptsz_v7000,
    CUPTI_RUNTIME_TRACE_CBID_cudaLaunchCooperativeKernel_v9000,
    CUPTI_RUNTIME_TRACE_CBID_cudaLaunchCooperativeKernel_ptsz_v9000,
    CUPTI_RUNTIME_TRACE_CBID_cudaLaunchKernelExC_v11060,
    CUPTI_RUNTIME_TRACE_CBID_cudaLaunchKernelExC_ptsz_v11060,
    CUPTI_RUNTIME_TRACE_CBID_cudaGraphLaunch_v10000,
    CUPTI_RUNTIME_TRACE_CBID_cudaGraphLaunch_ptsz_v10000,
};

}  // namespace

/// What is called of the library, without which there is no tracing.
#define URGENGO_CUPTI_CALLS(X)           \
    X(cuptiSubscribe)                    \
    X(cuptiEnableCallback)               \
    X(cuptiActivityRegisterCallbacks)    \
    X(cuptiActivityEnable)               \
    X(cuptiActivityGetNextRecord)        \
    X(cuptiActivityGetNumDroppedRecords) \
    X(cuptiActivityFlushAll)             \
    X(cuptiGetTimestamp)                 \
    X(cuptiGetResultString)

/// The library's functions, typed.
struct CuptiTracer::Calls {
#define URGENGO_CUPTI(name) decltype(&::name) name = nullptr;
    URGENGO_CUPTI_CALLS(URGENGO_CUPTI)
#undef URGENGO_CUPTI
    /// Says which tool has it; since CUPTI 13. The type is not in older headers.
    struct Names {
        std::size_t bytes;
        const char* ours;
        char* theirs;
        std::size_t theirs_bytes;
    };
    CUptiResult (*cuptiSubscribe_v2)(CUpti_SubscriberHandle*, CUpti_CallbackFunc, void*,
                                     Names*) = nullptr;

    /// @returns the name of a function that the library lacks; null if none
    const char* load(void* library) {
        const char* lacking = nullptr;
        const auto find = [&](auto& function, const char* name) {
            function =
                reinterpret_cast<std::remove_reference_t<decltype(function)>>(dlsym(library, name));
            if (!function) lacking = name;
        };
#define URGENGO_CUPTI(name) find(name, #name);
        URGENGO_CUPTI_CALLS(URGENGO_CUPTI)
#undef URGENGO_CUPTI
        cuptiSubscribe_v2 =
            reinterpret_cast<decltype(cuptiSubscribe_v2)>(dlsym(library, "cuptiSubscribe_v2"));
        return lacking;
    }

    std::string text(CUptiResult result) const {
        const char* text = nullptr;
        cuptiGetResultString(result, &text);
        return text ? text : "error " + std::to_string(result);
    }

    CUptiResult subscribe(CUpti_SubscriberHandle* subscriber, CUpti_CallbackFunc callback,
                          std::string& holder) const {
        if (!cuptiSubscribe_v2) return cuptiSubscribe(subscriber, callback, nullptr);
        char name[128] = {};
        Names names{sizeof(Names), "UrgenGo", name, sizeof name - 1};
        const CUptiResult result = cuptiSubscribe_v2(subscriber, callback, nullptr, &names);
        holder = name;
        return result;
    }
};

/// What CUPTI calls, and what that needs: it has no object to be called with.
struct CuptiTracer::Callbacks {
    static inline Calls calls;
    static inline std::mutex mutex;  ///< guards `writer` and `cursor`
    static inline observe::TraceWriter* writer = nullptr;
    static inline observe::TraceCursor cursor;
    static inline std::atomic<std::int64_t> last_flush_ns{0};

    static void CUPTIAPI on_call(void*, CUpti_CallbackDomain domain, CUpti_CallbackId,
                                 const void* data) {
        const auto* call = static_cast<const CUpti_CallbackData*>(data);
        const bool enters = call->callbackSite == CUPTI_API_ENTER;
        if (domain == CUPTI_CB_DOMAIN_DRIVER_API) {
            if (enters) t_driver_id = call->correlationId;
        } else if (domain == CUPTI_CB_DOMAIN_RUNTIME_API) {
            t_runtime_id = enters ? call->correlationId : 0;
        }
    }

    static void CUPTIAPI give_buffer(std::uint8_t** buffer, std::size_t* size,
                                     std::size_t* max_records) {
        *buffer = static_cast<std::uint8_t*>(std::aligned_alloc(kBufferAlignment, kBufferBytes));
        *size = *buffer ? kBufferBytes : 0;
        *max_records = 0;
    }

    static void CUPTIAPI take_buffer(CUcontext context, std::uint32_t stream, std::uint8_t* buffer,
                                     std::size_t, std::size_t valid_bytes) {
        {
            const std::lock_guard lock(mutex);
            CUpti_Activity* record = nullptr;
            while (writer && valid_bytes > 0 &&
                   calls.cuptiActivityGetNextRecord(buffer, valid_bytes, &record) == CUPTI_SUCCESS)
                if (record->kind == CUPTI_ACTIVITY_KIND_CONCURRENT_KERNEL) write(record);
            std::size_t dropped = 0;
            calls.cuptiActivityGetNumDroppedRecords(context, stream, &dropped);
            if (writer)
                writer->header().dropped_kernels += static_cast<std::uint32_t>(
                    std::min<std::size_t>(dropped, ~std::uint32_t{0} / 2));
        }
        std::free(buffer);
    }

    static void write(const CUpti_Activity* record) {
        KernelActivity kernel;
        std::memcpy(&kernel, record, sizeof kernel);
        if (kernel.name && std::string_view(kernel.name).starts_with(kOwnKernels)) return;
        TraceRecord* line = writer->add(cursor, nanoseconds{0});
        if (!line) return;
        const auto product = [](int x, int y, int z) {
            return std::uint64_t(std::max(x, 1)) * std::uint64_t(std::max(y, 1)) *
                   std::uint64_t(std::max(z, 1));
        };
        line->kernel.begin = kernel.start;
        line->kernel.end = kernel.end;
        line->kernel.correlation = kernel.correlationId;
        line->kernel.stream = kernel.streamId;
        line->kernel.context = kernel.contextId;
        line->kernel.grid_blocks = static_cast<std::uint32_t>(std::min<std::uint64_t>(
            product(kernel.gridX, kernel.gridY, kernel.gridZ), ~std::uint32_t{0}));
        line->kernel.block_threads =
            static_cast<std::uint32_t>(product(kernel.blockX, kernel.blockY, kernel.blockZ));
        observe::TraceWriter::publish(*line, TraceKind::kKernelTime);
    }

    static void write_clocks() {
        nanoseconds best_time{0}, best_length = nanoseconds::max();
        std::uint64_t best = 0;
        for (int i = 0; i < kClockTries; ++i) {
            std::uint64_t theirs = 0;
            const nanoseconds before = monotonic_now();
            if (calls.cuptiGetTimestamp(&theirs) != CUPTI_SUCCESS) return;
            const nanoseconds length = monotonic_now() - before;
            if (length >= best_length) continue;
            best_length = length, best_time = before + length / 2, best = theirs;
        }
        const std::lock_guard lock(mutex);
        TraceRecord* line = writer ? writer->add(cursor, best_time) : nullptr;
        if (!line) return;
        line->cupti_ns = best;
        observe::TraceWriter::publish(*line, TraceKind::kClockPair);
    }
};

namespace {

void* open_library(const std::string& asked, std::string& path) {
    for (const std::string& name : cupti_names())
        if (void* library = dlopen(name.c_str(), RTLD_NOW | RTLD_NOLOAD))
            return path = name, library;
    const char* home = std::getenv("CUDA_HOME");
    if (!home) home = std::getenv("CUDA_PATH");
    for (const std::string& file : cupti_candidates(asked, mapped_libraries(), home ? home : ""))
        if (void* library = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL))
            return path = file, library;
    return nullptr;
}

}  // namespace

Result<CuptiTracer*> CuptiTracer::try_to_start(const std::string& asked) {
    std::string path;
    void* const library = open_library(asked, path);
    if (!library) return Error{"no libcupti was found"};
    Calls& calls = Callbacks::calls;
    if (const char* lacking = calls.load(library)) return Error{path + " lacks " + lacking};
    const auto failed = [&](CUptiResult result, const char* what) {
        return Error{path + ": " + what + ": " + calls.text(result)};
    };
    CUpti_SubscriberHandle subscriber = nullptr;
    std::string holder;
    CUptiResult result = calls.subscribe(&subscriber, Callbacks::on_call, holder);
    if (result == CUPTI_ERROR_MULTIPLE_SUBSCRIBERS_NOT_SUPPORTED || (result && !holder.empty()))
        return Error{"CUPTI is held by " + (holder.empty() ? "another tool" : holder)};
    if (result != CUPTI_SUCCESS) return failed(result, "cuptiSubscribe");
    for (const CUpti_CallbackId call : kDriverCalls)
        result = std::max(
            result, calls.cuptiEnableCallback(1, subscriber, CUPTI_CB_DOMAIN_DRIVER_API, call));
    if (result != CUPTI_SUCCESS) return failed(result, "cuptiEnableCallback");
    // An older library may lack one of these.
    for (const CUpti_CallbackId call : kRuntimeCalls)
        calls.cuptiEnableCallback(1, subscriber, CUPTI_CB_DOMAIN_RUNTIME_API, call);
    result = calls.cuptiActivityRegisterCallbacks(Callbacks::give_buffer, Callbacks::take_buffer);
    if (result != CUPTI_SUCCESS) return failed(result, "cuptiActivityRegisterCallbacks");
    result = calls.cuptiActivityEnable(CUPTI_ACTIVITY_KIND_CONCURRENT_KERNEL);
    if (result != CUPTI_SUCCESS) return failed(result, "cuptiActivityEnable");
    return new CuptiTracer;
}

void CuptiTracer::attach(observe::TraceWriter& writer) {
    {
        const std::lock_guard lock(Callbacks::mutex);
        Callbacks::writer = &writer;
    }
    Callbacks::write_clocks();
}

void CuptiTracer::launch_begins() {
    t_driver_id = 0;
}

void CuptiTracer::describe_launch(TraceRecord& record) {
    if (t_driver_id == 0 && t_runtime_id == 0) return;
    record.flags |= abi::kTraceCorrelated;
    record.launch.correlations = {t_driver_id, t_runtime_id};
}

void CuptiTracer::flush_now_and_then(nanoseconds now) {
    std::int64_t last = Callbacks::last_flush_ns.load(std::memory_order_relaxed);
    if (now.count() - last < kFlushEvery.count() ||
        !Callbacks::last_flush_ns.compare_exchange_strong(last, now.count()))
        return;
    Callbacks::write_clocks();
    Callbacks::calls.cuptiActivityFlushAll(0);
}

void CuptiTracer::finish() {
    Callbacks::write_clocks();
    Callbacks::calls.cuptiActivityFlushAll(CUPTI_ACTIVITY_FLAG_FLUSH_FORCED);
    const std::lock_guard lock(Callbacks::mutex);
    Callbacks::writer = nullptr;
}

}  // namespace urgengo::exec

#else

namespace urgengo::exec {

Result<CuptiTracer*> CuptiTracer::try_to_start(const std::string&) {
    return Error{"UrgenGo was built without cupti.h"};
}
void CuptiTracer::attach(observe::TraceWriter&) {}
void CuptiTracer::launch_begins() {}
void CuptiTracer::describe_launch(abi::TraceRecord&) {}
void CuptiTracer::flush_now_and_then(nanoseconds) {}
void CuptiTracer::finish() {}

}  // namespace urgengo::exec
#endif

namespace urgengo::exec {

const Result<CuptiTracer*>& CuptiTracer::start(const std::string& library) {
    static const auto& started = *new Result<CuptiTracer*>(try_to_start(library));
    return started;
}

}  // namespace urgengo::exec
