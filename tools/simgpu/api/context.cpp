// SPDX-License-Identifier: Apache-2.0
//
// Contexts, the primary one, and each thread's stack of them.
#include <array>

#include "tools/simgpu/api/context_stack.h"
#include "tools/simgpu/api/driver_state.h"
#include "tools/simgpu/graph/capture.h"

using namespace urgengo::simgpu;

namespace urgengo::simgpu {

std::shared_ptr<Context> make_context(unsigned flags, CUdevice device) {
    auto context = std::make_shared<Context>();
    context->device = device;
    context->id = driver().next_id++;
    context->flags = flags;
    context->legacy = make_stream(*context, StreamQueue::Kind::kLegacy, CU_STREAM_DEFAULT, 0);
    context->num_sms = static_cast<unsigned>(driver().part.num_sms);
    driver().contexts.add(context);
    return context;
}

void tear_down(Context& context) {
    abandon_captures(context);
    synchronize(context);
    context.destroyed = true;
    const auto is_its = [&context](const auto& object) { return object.context == &context; };
    Driver& state = driver();
    state.streams.remove_if(is_its);
    state.events.remove_if(is_its);
    state.functions.remove_if(is_its);
    state.modules.remove_if(is_its);
    state.mipmapped_arrays.remove_if(is_its);
    for (const Allocation& allocation : state.memory.remove_all_of(&context)) {
        if (allocation.pool) allocation.pool->lose(allocation);
    }
    std::lock_guard lock(context.mutex);
    context.per_thread.clear();
    context.queues = std::vector{context.legacy->queue};  // a primary context comes back with it
}

}  // namespace urgengo::simgpu

namespace {

/// A device's primary context keeps its handle through release and retain, as the driver's does.
struct Primary {
    std::mutex mutex;
    CUcontext handle = nullptr;
    unsigned num_retained = 0;
    unsigned flags = 0;
};

Primary& primary(CUdevice device) {
    static auto* const instances = new std::array<Primary, Part::kMostInMachine>;
    return (*instances)[static_cast<std::size_t>(device)];
}

CUcontext to_handle(Context* context) {
    return reinterpret_cast<CUcontext>(context);
}

/// Finds a context by handle, or the current one if the handle is null.
CUresult find_context(CUcontext handle, Context*& context) {
    if (handle == nullptr) return current_context(context);
    if (CUresult error = require_init()) return error;
    context = driver().contexts.find(handle).get();
    if (context == nullptr) return CUDA_ERROR_INVALID_CONTEXT;
    return context->destroyed ? CUDA_ERROR_CONTEXT_IS_DESTROYED : context->broken.load();
}

bool is_primary(const Context& context) {
    Primary& its = primary(context.device);
    std::lock_guard lock(its.mutex);
    return to_handle(const_cast<Context*>(&context)) == its.handle;
}

/// The calling thread's stack keeps what else it has of the context.
void destroy(Context& context) {
    tear_down(context);
    ContextStack& stack = ContextStack::of_this_thread();
    if (stack.top() == &context) stack.pop();
}

CUresult create(CUcontext* handle, unsigned flags, CUdevice device) {
    if (CUresult error = require_init()) return error;
    if (handle == nullptr) return CUDA_ERROR_INVALID_VALUE;
    if (CUresult error = require_device(device)) return error;
    *handle = to_handle(make_context(flags, device).get());
    return cuCtxPushCurrent_v2(*handle);
}

}  // namespace

SIMGPU_API CUresult cuDevicePrimaryCtxRetain(CUcontext* handle, CUdevice device) {
    if (CUresult error = require_device(device)) return error;
    if (handle == nullptr) return CUDA_ERROR_INVALID_VALUE;
    Primary& its = primary(device);
    std::lock_guard lock(its.mutex);
    if (its.handle == nullptr) its.handle = to_handle(make_context(its.flags, device).get());
    Context& context = *driver().contexts.find(its.handle);
    if (its.num_retained++ == 0) {
        context.flags = its.flags;
        context.destroyed = false;
        context.broken = CUDA_SUCCESS;
    }
    *handle = its.handle;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuDevicePrimaryCtxRelease_v2(CUdevice device) {
    if (CUresult error = require_device(device)) return error;
    Primary& its = primary(device);
    std::lock_guard lock(its.mutex);
    if (its.num_retained == 0) return CUDA_ERROR_INVALID_CONTEXT;
    if (--its.num_retained == 0) tear_down(*driver().contexts.find(its.handle));
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuDevicePrimaryCtxRelease(CUdevice device) {
    return cuDevicePrimaryCtxRelease_v2(device);
}

SIMGPU_API CUresult cuDevicePrimaryCtxReset_v2(CUdevice device) {
    if (CUresult error = require_device(device)) return error;
    Primary& its = primary(device);
    std::lock_guard lock(its.mutex);
    if (its.num_retained > 0) {
        its.num_retained = 0;
        tear_down(*driver().contexts.find(its.handle));
    }
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuDevicePrimaryCtxReset(CUdevice device) {
    return cuDevicePrimaryCtxReset_v2(device);
}

SIMGPU_API CUresult cuDevicePrimaryCtxGetState(CUdevice device, unsigned* flags, int* active) {
    if (CUresult error = require_device(device)) return error;
    Primary& its = primary(device);
    std::lock_guard lock(its.mutex);
    if (flags != nullptr) *flags = its.flags;
    if (active != nullptr) *active = its.num_retained > 0 ? 1 : 0;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuDevicePrimaryCtxSetFlags_v2(CUdevice device, unsigned flags) {
    if (CUresult error = require_device(device)) return error;
    if ((flags & ~static_cast<unsigned>(CU_CTX_FLAGS_MASK)) != 0) return CUDA_ERROR_INVALID_VALUE;
    Primary& its = primary(device);
    std::lock_guard lock(its.mutex);
    its.flags = flags;
    if (its.handle != nullptr) driver().contexts.find(its.handle)->flags = flags;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuDevicePrimaryCtxSetFlags(CUdevice device, unsigned flags) {
    return cuDevicePrimaryCtxSetFlags_v2(device, flags);
}

SIMGPU_API CUresult cuCtxCreate(CUcontext* handle, unsigned flags, CUdevice device) {
    return create(handle, flags, device);
}

SIMGPU_API CUresult cuCtxCreate_v2(CUcontext* handle, unsigned flags, CUdevice device) {
    return create(handle, flags, device);
}

SIMGPU_API CUresult cuCtxCreate_v3(CUcontext* handle, CUexecAffinityParam* params, int num_params,
                                   unsigned flags, CUdevice device) {
    // Execution affinity (fewer SMs) needs MPS, which there is not.
    if (num_params != 0) return CUDA_ERROR_NOT_SUPPORTED;
    return create(handle, flags, device);
}

#if CUDA_VERSION >= 12050
SIMGPU_API CUresult cuCtxCreate_v4(CUcontext* handle, CUctxCreateParams* params, unsigned flags,
                                   CUdevice device) {
    const bool asks_for_more =
        params != nullptr && (params->numExecAffinityParams != 0 || params->cigParams != nullptr);
    if (asks_for_more) return CUDA_ERROR_NOT_SUPPORTED;
    return create(handle, flags, device);
}
#endif

SIMGPU_API CUresult cuCtxDestroy_v2(CUcontext handle) {
    if (CUresult error = require_init()) return error;
    Context* context = driver().contexts.find(handle).get();
    if (context == nullptr) return CUDA_ERROR_INVALID_CONTEXT;
    if (context->destroyed) return CUDA_ERROR_CONTEXT_IS_DESTROYED;
    if (context->primary != nullptr) return CUDA_ERROR_INVALID_CONTEXT;  // cuGreenCtxDestroy's
    if (is_primary(*context)) return CUDA_ERROR_INVALID_CONTEXT;
    destroy(*context);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuCtxDestroy(CUcontext handle) {
    return cuCtxDestroy_v2(handle);
}

SIMGPU_API CUresult cuCtxAttach(CUcontext* handle, unsigned flags) {
    Context* context = nullptr;
    if (CUresult error = current_context(context)) return error;
    if (handle == nullptr || flags != 0) return CUDA_ERROR_INVALID_VALUE;
    ++context->usage;
    *handle = to_handle(context);
    return CUDA_SUCCESS;
}

// The last one destroys. Detaching a primary context does nothing (measured, H100, driver
// 580.159.04).
SIMGPU_API CUresult cuCtxDetach(CUcontext handle) {
    Context* context = nullptr;
    if (CUresult error = current_context(context)) return error;
    if (handle != to_handle(context)) return CUDA_ERROR_INVALID_CONTEXT;
    if (context->primary != nullptr || is_primary(*context)) return CUDA_SUCCESS;
    if (--context->usage == 0) destroy(*context);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuCtxPushCurrent_v2(CUcontext handle) {
    if (CUresult error = require_init()) return error;
    Context* context = driver().contexts.find(handle).get();
    if (context == nullptr) return CUDA_ERROR_INVALID_CONTEXT;
    if (context->destroyed) return CUDA_ERROR_CONTEXT_IS_DESTROYED;
    return ContextStack::of_this_thread().push(context) ? CUDA_SUCCESS : CUDA_ERROR_OUT_OF_MEMORY;
}

SIMGPU_API CUresult cuCtxPushCurrent(CUcontext handle) {
    return cuCtxPushCurrent_v2(handle);
}

SIMGPU_API CUresult cuCtxPopCurrent_v2(CUcontext* handle) {
    if (CUresult error = require_init()) return error;
    Context* context = ContextStack::of_this_thread().pop();
    if (context == nullptr) return CUDA_ERROR_INVALID_CONTEXT;
    if (handle != nullptr) *handle = to_handle(context);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuCtxPopCurrent(CUcontext* handle) {
    return cuCtxPopCurrent_v2(handle);
}

SIMGPU_API CUresult cuCtxSetCurrent(CUcontext handle) {
    if (CUresult error = require_init()) return error;
    Context* context = handle == nullptr ? nullptr : driver().contexts.find(handle).get();
    if (handle != nullptr && context == nullptr) return CUDA_ERROR_INVALID_CONTEXT;
    if (context != nullptr && context->destroyed) return CUDA_ERROR_CONTEXT_IS_DESTROYED;
    ContextStack::of_this_thread().set_top(context);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuCtxGetCurrent(CUcontext* handle) {
    if (CUresult error = require_init()) return error;
    if (handle == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *handle = to_handle(ContextStack::of_this_thread().top());
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuCtxGetDevice_v2(CUdevice* device, CUcontext handle) {
    Context* context = nullptr;
    if (CUresult error = find_context(handle, context)) return error;
    if (device == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *device = context->device;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuCtxGetDevice(CUdevice* device) {
    return cuCtxGetDevice_v2(device, nullptr);
}

SIMGPU_API CUresult cuCtxSynchronize_v2(CUcontext handle) {
    Context* context = nullptr;
    if (CUresult error = find_context(handle, context)) return error;
    if (CUresult error = require_no_capture(*context)) return error;
    synchronize(*context);
    return context->broken;
}

SIMGPU_API CUresult cuCtxSynchronize() {
    return cuCtxSynchronize_v2(nullptr);
}

// Kept only; but the thread that sets one waits for the context's work, as on the driver.
SIMGPU_API CUresult cuCtxSetLimit(CUlimit limit, std::size_t value) {
    Context* context = nullptr;
    if (CUresult error = current_context(context)) return error;
    std::unique_lock lock(context->mutex);
    const auto found = context->limits.find(limit);
    if (found == context->limits.end()) return CUDA_ERROR_UNSUPPORTED_LIMIT;
    lock.unlock();
    if (CUresult error = require_no_capture(*context)) return error;
    synchronize(*context);
    lock.lock();
    found->second = value;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuCtxGetLimit(std::size_t* value, CUlimit limit) {
    Context* context = nullptr;
    if (CUresult error = current_context(context)) return error;
    if (value == nullptr) return CUDA_ERROR_INVALID_VALUE;
    const std::lock_guard lock(context->mutex);
    const auto found = context->limits.find(limit);
    if (found == context->limits.end()) return CUDA_ERROR_UNSUPPORTED_LIMIT;
    *value = found->second;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuCtxGetFlags(unsigned* flags) {
    Context* context = nullptr;
    if (CUresult error = current_context(context)) return error;
    if (flags == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *flags = context->flags | CU_CTX_MAP_HOST;  // which cannot be switched off, as on the driver
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuCtxGetApiVersion(CUcontext handle, unsigned* version) {
    Context* context = nullptr;
    if (CUresult error = find_context(handle, context)) return error;
    if (version == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *version = 3020;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuCtxGetId(CUcontext handle, unsigned long long* id) {
    Context* context = nullptr;
    if (CUresult error = find_context(handle, context)) return error;
    if (id == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *id = context->id;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuCtxGetStreamPriorityRange(int* least, int* greatest) {
    Context* context = nullptr;
    if (CUresult error = current_context(context)) return error;
    if (least != nullptr) *least = kLeastPriority;
    if (greatest != nullptr) *greatest = kGreatestPriority;
    return CUDA_SUCCESS;
}
