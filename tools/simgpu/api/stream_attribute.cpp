// SPDX-License-Identifier: Apache-2.0
//
// Stream attributes. The priority has an effect; the others are kept and given back.
#include "tools/simgpu/api/driver_state.h"

using namespace urgengo::simgpu;

namespace {

bool is_kept(CUstreamAttrID id) {
    return id == CU_LAUNCH_ATTRIBUTE_ACCESS_POLICY_WINDOW ||
           id == CU_LAUNCH_ATTRIBUTE_SYNCHRONIZATION_POLICY ||
           id == CU_LAUNCH_ATTRIBUTE_MEM_SYNC_DOMAIN_MAP ||
           id == CU_LAUNCH_ATTRIBUTE_MEM_SYNC_DOMAIN;
}

}  // namespace

SIMGPU_API CUresult cuStreamSetAttribute(CUstream handle, CUstreamAttrID id,
                                         const CUstreamAttrValue* value) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream(handle, stream)) return error;
    if (value == nullptr) return CUDA_ERROR_INVALID_VALUE;
    if (id == CU_LAUNCH_ATTRIBUTE_PRIORITY) {
        stream->priority = clamp_priority(value->priority);
        return CUDA_SUCCESS;
    }
    if (!is_kept(id)) return CUDA_ERROR_INVALID_VALUE;
    std::lock_guard lock(stream->attributes_mutex);
    stream->attributes[id] = *value;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuStreamGetAttribute(CUstream handle, CUstreamAttrID id,
                                         CUstreamAttrValue* value) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream(handle, stream)) return error;
    if (value == nullptr) return CUDA_ERROR_INVALID_VALUE;
    *value = {};
    if (id == CU_LAUNCH_ATTRIBUTE_PRIORITY) {
        value->priority = stream->priority;
        return CUDA_SUCCESS;
    }
    if (!is_kept(id)) return CUDA_ERROR_INVALID_VALUE;
    std::lock_guard lock(stream->attributes_mutex);
    const auto it = stream->attributes.find(id);
    if (it != stream->attributes.end()) *value = it->second;
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuStreamCopyAttributes(CUstream to_handle, CUstream from_handle) {
    std::shared_ptr<Stream> to;
    std::shared_ptr<Stream> from;
    if (CUresult error = resolve_stream(to_handle, to)) return error;
    if (CUresult error = resolve_stream(from_handle, from)) return error;
    if (to == from) return CUDA_SUCCESS;
    to->priority = from->priority.load();
    std::scoped_lock lock(to->attributes_mutex, from->attributes_mutex);
    to->attributes = from->attributes;
    return CUDA_SUCCESS;
}
