// SPDX-License-Identifier: Apache-2.0
//
// Green contexts: contexts beside the primary one, with streams of their own and everything else
// shared with it. The SMs that they are given are said, but not kept apart: all run on the same.
#include <algorithm>

#include "tools/simgpu/api/context_stack.h"
#include "tools/simgpu/api/driver_state.h"

#if CUDA_VERSION >= 12040

using namespace urgengo::simgpu;

/// What a resource descriptor stands for.
struct CUdevResourceDesc_st {
    CUdevResource sms;
};

namespace {

unsigned alignment() {
    return driver().part.compute_major >= 9 ? 8 : 2;
}

CUdevResource sm_resource(unsigned count) {
    CUdevResource resource{};
    resource.type = CU_DEV_RESOURCE_TYPE_SM;
    resource.sm.smCount = count;
    return resource;
}

CUgreenCtx to_green(Context* context) {
    return reinterpret_cast<CUgreenCtx>(context);
}

CUresult find_green(CUgreenCtx handle, Context*& context) {
    if (CUresult error = require_init()) return error;
    context = driver().contexts.find(reinterpret_cast<CUcontext>(handle)).get();
    const bool is_green = context != nullptr && context->primary != nullptr;
    if (!is_green) return CUDA_ERROR_INVALID_CONTEXT;
    return context->destroyed ? CUDA_ERROR_CONTEXT_IS_DESTROYED : CUDA_SUCCESS;
}

CUresult give_sms(CUdevResource* resource, CUdevResourceType type, unsigned count) {
    if (resource == nullptr) return CUDA_ERROR_INVALID_VALUE;
    if (type != CU_DEV_RESOURCE_TYPE_SM) return CUDA_ERROR_INVALID_RESOURCE_TYPE;
    *resource = sm_resource(count);
    return CUDA_SUCCESS;
}

}  // namespace

SIMGPU_API CUresult cuDeviceGetDevResource(CUdevice device, CUdevResource* resource,
                                           CUdevResourceType type) {
    if (CUresult error = require_device(device)) return error;
    return give_sms(resource, type, static_cast<unsigned>(driver().part.num_sms));
}

SIMGPU_API CUresult cuCtxGetDevResource(CUcontext handle, CUdevResource* resource,
                                        CUdevResourceType type) {
    if (CUresult error = require_init()) return error;
    const auto context = driver().contexts.find(handle);
    if (!context || context->destroyed) return CUDA_ERROR_INVALID_CONTEXT;
    return give_sms(resource, type, context->num_sms);
}

SIMGPU_API CUresult cuGreenCtxGetDevResource(CUgreenCtx handle, CUdevResource* resource,
                                             CUdevResourceType type) {
    Context* context = nullptr;
    if (CUresult error = find_green(handle, context)) return error;
    return give_sms(resource, type, context->num_sms);
}

SIMGPU_API CUresult cuDevSmResourceSplitByCount(CUdevResource* result, unsigned* num_groups,
                                                const CUdevResource* input,
                                                CUdevResource* remaining, unsigned flags,
                                                unsigned min_count) {
    if (CUresult error = require_init()) return error;
    const bool valid = num_groups != nullptr && input != nullptr &&
                       input->type == CU_DEV_RESOURCE_TYPE_SM && min_count <= input->sm.smCount;
    if (!valid) return CUDA_ERROR_INVALID_VALUE;
    const unsigned unit = alignment();
    const unsigned size = (std::max(min_count, unit) + unit - 1) / unit * unit;
    const unsigned possible = input->sm.smCount / size;
    if (result == nullptr) {
        *num_groups = possible;
        return CUDA_SUCCESS;
    }
    *num_groups = std::min(*num_groups, possible);
    std::fill_n(result, *num_groups, sm_resource(size));
    if (remaining != nullptr) *remaining = sm_resource(input->sm.smCount - *num_groups * size);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuDevResourceGenerateDesc(CUdevResourceDesc* desc, CUdevResource* resources,
                                              unsigned count) {
    if (CUresult error = require_init()) return error;
    if (desc == nullptr || resources == nullptr || count == 0) return CUDA_ERROR_INVALID_VALUE;
    unsigned num_sms = 0;
    for (unsigned i = 0; i < count; ++i) {
        if (resources[i].type != CU_DEV_RESOURCE_TYPE_SM) return CUDA_ERROR_INVALID_RESOURCE_TYPE;
        num_sms += resources[i].sm.smCount;
    }
    // Kept to the end: there is no call to free one.
    static std::mutex mutex;
    static auto& all = *new std::vector<std::unique_ptr<CUdevResourceDesc_st>>;
    const std::lock_guard lock(mutex);
    all.push_back(
        std::make_unique<CUdevResourceDesc_st>(CUdevResourceDesc_st{sm_resource(num_sms)}));
    *desc = all.back().get();
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuGreenCtxCreate(CUgreenCtx* handle, CUdevResourceDesc desc, CUdevice device,
                                     unsigned flags) {
    if (CUresult error = require_device(device)) return error;
    const bool valid = handle != nullptr && desc != nullptr && flags == CU_GREEN_CTX_DEFAULT_STREAM;
    if (!valid) return CUDA_ERROR_INVALID_VALUE;
    CUcontext primary = nullptr;
    if (CUresult error = cuDevicePrimaryCtxRetain(&primary, device)) return error;
    const auto green = make_context(0, device);
    green->primary = driver().contexts.find(primary).get();
    green->num_sms = desc->sms.sm.smCount;
    *handle = to_green(green.get());
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuGreenCtxDestroy(CUgreenCtx handle) {
    Context* context = nullptr;
    if (CUresult error = find_green(handle, context)) return error;
    tear_down(*context);
    ContextStack& stack = ContextStack::of_this_thread();
    if (stack.top() == context) stack.pop();
    return cuDevicePrimaryCtxRelease_v2(context->device);
}

SIMGPU_API CUresult cuCtxFromGreenCtx(CUcontext* handle, CUgreenCtx green) {
    Context* context = nullptr;
    if (CUresult error = find_green(green, context)) return error;
    if (handle == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *handle = reinterpret_cast<CUcontext>(context);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuStreamGetGreenCtx(CUstream handle, CUgreenCtx* green) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream(handle, stream)) return error;
    if (green == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *green = stream->context->primary != nullptr ? to_green(stream->context) : nullptr;
    return CUDA_SUCCESS;
}

#if CUDA_VERSION >= 12050
SIMGPU_API CUresult cuGreenCtxStreamCreate(CUstream* handle, CUgreenCtx green, unsigned flags,
                                           int priority) {
    Context* context = nullptr;
    if (CUresult error = find_green(green, context)) return error;
    if (handle == nullptr || flags != CU_STREAM_NON_BLOCKING) return CUDA_ERROR_INVALID_VALUE;
    *handle = driver().streams.add(
        make_stream(*context, StreamQueue::Kind::kNonBlocking, flags, priority));
    return CUDA_SUCCESS;
}
#endif

#endif
