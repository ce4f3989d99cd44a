// SPDX-License-Identifier: Apache-2.0
//
// Events. A record is a command that takes no time; the event keeps the fence of the last one.
#include "tools/simgpu/api/event.h"

#include "tools/simgpu/engine/zero_cost.h"
#include "tools/simgpu/graph/capture.h"

using namespace urgengo::simgpu;

namespace urgengo::simgpu {

Fence last_record(Event& event) {
    std::lock_guard lock(event.mutex);
    return event.fence;
}

}  // namespace urgengo::simgpu

namespace {

CUresult record(CUevent handle, CUstream stream_handle, unsigned flags) {
    if (zero_cost()) return handle ? CUDA_SUCCESS : CUDA_ERROR_INVALID_HANDLE;
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream_for_work(stream_handle, stream)) return error;
    const auto event = driver().events.find(handle);
    if (!event || event->context->owner() != stream->context->owner())
        return CUDA_ERROR_INVALID_HANDLE;
    // It means something during a capture only, and there is none.
    if (flags == CU_EVENT_RECORD_EXTERNAL) return CUDA_ERROR_ILLEGAL_STATE;
    if (flags != CU_EVENT_RECORD_DEFAULT) return CUDA_ERROR_INVALID_VALUE;

    capture_event_record(*stream, *event);
    if (is_capturing(*stream)) return CUDA_SUCCESS;
    auto time = std::make_shared<std::atomic<std::int64_t>>(0);
    std::lock_guard lock(event->mutex);
    event->fence = submit(*stream, TimedWork{Time{0}, [time](Time end) { *time = end.count(); }});
    event->time = std::move(time);
    return CUDA_SUCCESS;
}

struct Recorded {
    Fence fence;
    std::shared_ptr<std::atomic<std::int64_t>> time;
};

/// @returns the event's last record; with no time if there is none, or none is kept
Recorded timed_record(Event& event) {
    std::lock_guard lock(event.mutex);
    if ((event.flags & CU_EVENT_DISABLE_TIMING) != 0) return {};
    return {event.fence, event.time};
}

CUresult elapsed_time(float* milliseconds, CUevent start_handle, CUevent end_handle) {
    if (CUresult error = require_init()) return error;
    if (milliseconds == nullptr) return CUDA_ERROR_INVALID_VALUE;
    const auto start = driver().events.find(start_handle);
    const auto end = driver().events.find(end_handle);
    if (!start || !end) return CUDA_ERROR_INVALID_HANDLE;
    if (zero_cost()) {  // nothing takes any time
        *milliseconds = 0;
        return CUDA_SUCCESS;
    }
    const Recorded first = timed_record(*start);
    const Recorded last = timed_record(*end);
    if (!first.time || !last.time) return CUDA_ERROR_INVALID_HANDLE;
    if (!first.fence.passed() || !last.fence.passed()) return CUDA_ERROR_NOT_READY;
    constexpr double kNsPerMs = 1e6;
    *milliseconds = static_cast<float>(static_cast<double>(*last.time - *first.time) / kNsPerMs);
    return CUDA_SUCCESS;
}

}  // namespace

SIMGPU_API CUresult cuEventCreate(CUevent* handle, unsigned flags) {
    Context* context = nullptr;
    if (CUresult error = current_context(context)) return error;
    constexpr unsigned kKnown = CU_EVENT_BLOCKING_SYNC | CU_EVENT_DISABLE_TIMING;
    // CU_EVENT_INTERPROCESS is refused too: there is no other process to share it with.
    if (handle == nullptr || (flags & ~kKnown) != 0) return CUDA_ERROR_INVALID_VALUE;
    auto event = std::make_shared<Event>();
    event->context = context->owner();
    event->flags = flags;
    *handle = driver().events.add(std::move(event));
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuEventDestroy_v2(CUevent handle) {
    if (CUresult error = require_init()) return error;
    return driver().events.remove(handle) ? CUDA_SUCCESS : CUDA_ERROR_INVALID_HANDLE;
}

SIMGPU_API CUresult cuEventDestroy(CUevent handle) {
    return cuEventDestroy_v2(handle);
}

SIMGPU_API CUresult cuEventRecord(CUevent handle, CUstream stream) {
    return record(handle, stream, CU_EVENT_RECORD_DEFAULT);
}

SIMGPU_API CUresult cuEventRecordWithFlags(CUevent handle, CUstream stream, unsigned flags) {
    return record(handle, stream, flags);
}

SIMGPU_API CUresult cuEventQuery(CUevent handle) {
    if (zero_cost()) return CUDA_SUCCESS;
    if (CUresult error = require_init()) return error;
    const auto event = driver().events.find(handle);
    if (!event) return CUDA_ERROR_INVALID_HANDLE;
    if (CUresult error = require_not_captured(*event)) return error;
    if (CUresult error = require_safe_call()) return error;
    if (CUresult error = event->context->broken) return error;
    return last_record(*event).passed() ? event->context->broken.load() : CUDA_ERROR_NOT_READY;
}

SIMGPU_API CUresult cuEventSynchronize(CUevent handle) {
    if (zero_cost()) return CUDA_SUCCESS;
    if (CUresult error = require_init()) return error;
    const auto event = driver().events.find(handle);
    if (!event) return CUDA_ERROR_INVALID_HANDLE;
    if (CUresult error = require_not_captured(*event)) return error;
    if (CUresult error = require_safe_call()) return error;
    last_record(*event).wait();
    trim_pools();
    return event->context->broken;
}

SIMGPU_API CUresult cuEventElapsedTime_v2(float* milliseconds, CUevent start, CUevent end) {
    return elapsed_time(milliseconds, start, end);
}

SIMGPU_API CUresult cuEventElapsedTime(float* milliseconds, CUevent start, CUevent end) {
    return elapsed_time(milliseconds, start, end);
}
