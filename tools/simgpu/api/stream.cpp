// SPDX-License-Identifier: Apache-2.0
//
// Streams: creation, queries, waiting, and host functions.
#include "tools/simgpu/api/driver_state.h"
#include "tools/simgpu/api/event.h"
#include "tools/simgpu/api/stack_use.h"
#include "tools/simgpu/engine/zero_cost.h"
#include "tools/simgpu/graph/capture.h"

using namespace urgengo::simgpu;

namespace {

/// Work that does nothing, to find out when a stream gets there.
Fence submit_marker(Stream& stream) {
    return submit(stream, TimedWork{});
}

/// A capture can take neither a query nor a synchronisation.
CUresult refuse_unless_idle(Stream& stream) {
    if (CUresult error = check_capture(stream)) return error;
    if (CUresult error = refuse_if_capturing(stream)) return error;
    return require_safe_call();
}

bool is_legacy(const Stream& stream) {
    return stream.queue->kind == StreamQueue::Kind::kLegacy;
}

CUresult create(CUstream* handle, unsigned flags, int priority) {
    Context* context = nullptr;
    if (CUresult error = current_context(context)) return error;
    if (handle == nullptr || (flags & ~unsigned{CU_STREAM_NON_BLOCKING}) != 0) {
        return CUDA_ERROR_INVALID_VALUE;
    }
    use_stack_of_large_call();
    const auto kind = (flags & CU_STREAM_NON_BLOCKING) != 0 ? StreamQueue::Kind::kNonBlocking
                                                            : StreamQueue::Kind::kBlocking;
    *handle = driver().streams.add(make_stream(*context, kind, flags, priority));
    return CUDA_SUCCESS;
}

}  // namespace

SIMGPU_API CUresult cuStreamCreate(CUstream* handle, unsigned flags) {
    return create(handle, flags, kLeastPriority);
}

SIMGPU_API CUresult cuStreamCreateWithPriority(CUstream* handle, unsigned flags, int priority) {
    return create(handle, flags, priority);
}

SIMGPU_API CUresult cuStreamDestroy_v2(CUstream handle) {
    if (CUresult error = require_init()) return error;
    // What was submitted runs on: the engine shares the queue.
    const auto stream = driver().streams.remove(handle);
    if (!stream) return CUDA_ERROR_INVALID_HANDLE;
    abandon_capture(*stream);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuStreamDestroy(CUstream handle) {
    return cuStreamDestroy_v2(handle);
}

SIMGPU_API CUresult cuStreamSynchronize(CUstream handle) {
    if (zero_cost()) return CUDA_SUCCESS;
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream(handle, stream)) return error;
    if (CUresult error = refuse_unless_idle(*stream)) return error;
    // The legacy stream stands for all blocking ones: whatever comes next on it waits for them.
    const Fence end =
        is_legacy(*stream) ? submit_marker(*stream) : driver().gpu->tail(stream->queue);
    end.wait();
    trim_pools();
    return stream->context->broken;
}

SIMGPU_API CUresult cuStreamQuery(CUstream handle) {
    if (zero_cost()) return CUDA_SUCCESS;
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream(handle, stream)) return error;
    if (CUresult error = refuse_unless_idle(*stream)) return error;
    std::vector<std::shared_ptr<StreamQueue>> queues{stream->queue};
    if (is_legacy(*stream)) {
        std::lock_guard lock(stream->context->mutex);
        for (const auto& queue : stream->context->queues) {
            if (queue->kind == StreamQueue::Kind::kBlocking) queues.push_back(queue);
        }
    }
    for (const auto& queue : queues) {
        if (!driver().gpu->tail(queue).passed()) return CUDA_ERROR_NOT_READY;
    }
    return stream->context->broken;
}

SIMGPU_API CUresult cuStreamWaitEvent(CUstream handle, CUevent event_handle, unsigned flags) {
    if (zero_cost()) return CUDA_SUCCESS;
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream(handle, stream)) return error;
    const auto event = driver().events.find(event_handle);
    if (!event) return CUDA_ERROR_INVALID_HANDLE;
    if (flags == CU_EVENT_WAIT_EXTERNAL) return CUDA_ERROR_ILLEGAL_STATE;  // for captures only
    if (flags != CU_EVENT_WAIT_DEFAULT) return CUDA_ERROR_INVALID_VALUE;
    bool in_capture = false;
    if (CUresult error = check_capture(*stream)) return error;
    if (CUresult error = capture_event_wait(stream, *event, in_capture)) return error;
    if (in_capture) return CUDA_SUCCESS;
    Fence recorded = last_record(*event);
    if (!recorded.passed()) submit(*stream, TimedWork{}, {std::move(recorded)});
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuStreamGetPriority(CUstream handle, int* priority) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream(handle, stream)) return error;
    if (priority == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *priority = stream->priority;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuStreamGetFlags(CUstream handle, unsigned* flags) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream(handle, stream)) return error;
    if (flags == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *flags = stream->flags;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuStreamGetId(CUstream handle, unsigned long long* id) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream(handle, stream)) return error;
    if (id == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *id = stream->queue->id;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuStreamGetCtx(CUstream handle, CUcontext* context) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream(handle, stream)) return error;
    if (context == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *context = reinterpret_cast<CUcontext>(stream->context);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuStreamGetCtx_v2(CUstream handle, CUcontext* context, CUgreenCtx* green) {
    if (CUresult error = cuStreamGetCtx(handle, context)) return error;
    // A stream has the one or the other.
    const bool is_green = reinterpret_cast<Context*>(*context)->primary != nullptr;
    if (green != nullptr) *green = is_green ? reinterpret_cast<CUgreenCtx>(*context) : nullptr;
    if (is_green) *context = nullptr;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuStreamGetDevice(CUstream handle, CUdevice* device) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream(handle, stream)) return error;
    if (device == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *device = stream->context->device;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuLaunchHostFunc(CUstream handle, CUhostFn function, void* user_data) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream_for_work(handle, stream)) return error;
    if (function == nullptr) return CUDA_ERROR_INVALID_VALUE;
    submit(*stream, HostCall{[=] { function(user_data); }});
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuStreamAddCallback(CUstream handle, CUstreamCallback callback, void* user_data,
                                        unsigned flags) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream_for_work(handle, stream)) return error;
    if (callback == nullptr || flags != 0) return CUDA_ERROR_INVALID_VALUE;
    if (CUresult error = refuse_if_capturing(*stream)) return error;
    submit(*stream, HostCall{[=] { callback(handle, CUDA_SUCCESS, user_data); }});
    return CUDA_SUCCESS;
}
