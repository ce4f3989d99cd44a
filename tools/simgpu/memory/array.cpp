// SPDX-License-Identifier: Apache-2.0
//
// Arrays, as far as copies go: device memory in which rows follow each other. The handle is its
// address; a mipmapped array's is its own, and its levels lie in one piece of memory, none of them
// at its beginning, so that none can be freed by itself. Nothing reads them by texture.
#include <algorithm>
#include <bit>

#include "tools/simgpu/memory/copy.h"

using namespace urgengo::simgpu;

namespace {

constexpr std::size_t kLevelAlignment = 512;

std::uintptr_t address_of(CUarray array, std::size_t offset) {
    return array == nullptr ? 0 : reinterpret_cast<std::uintptr_t>(array) + offset;
}

std::size_t bytes_of(CUarray_format format) {
    switch (format) {
        case CU_AD_FORMAT_UNSIGNED_INT8:
        case CU_AD_FORMAT_SIGNED_INT8:
            return 1;
        case CU_AD_FORMAT_UNSIGNED_INT16:
        case CU_AD_FORMAT_SIGNED_INT16:
        case CU_AD_FORMAT_HALF:
            return 2;
        case CU_AD_FORMAT_UNSIGNED_INT32:
        case CU_AD_FORMAT_SIGNED_INT32:
        case CU_AD_FORMAT_FLOAT:
            return 4;
        default:
            return 0;
    }
}

CUresult to_host(void* to, CUarray from, std::size_t offset, std::size_t bytes, CUstream stream,
                 bool waits) {
    return copy({reinterpret_cast<std::uintptr_t>(to), address_of(from, offset), bytes,
                 CopyKind::kDeviceToHost, stream, waits});
}

CUresult from_host(CUarray to, std::size_t offset, const void* from, std::size_t bytes,
                   CUstream stream, bool waits) {
    return copy({address_of(to, offset), reinterpret_cast<std::uintptr_t>(from), bytes,
                 CopyKind::kHostToDevice, stream, waits});
}

CUresult on_device(std::uintptr_t to, std::uintptr_t from, std::size_t bytes, CUstream stream) {
    return copy({to, from, bytes, CopyKind::kDeviceToDevice, stream, true});
}

}  // namespace

SIMGPU_API CUresult cuArrayCreate_v2(CUarray* array, const CUDA_ARRAY_DESCRIPTOR* shape) {
    if (array == nullptr || shape == nullptr) return CUDA_ERROR_INVALID_VALUE;
    const std::size_t bytes = shape->Width * (shape->Height == 0 ? 1 : shape->Height) *
                              bytes_of(shape->Format) * shape->NumChannels;
    CUdeviceptr memory = 0;
    if (CUresult error = cuMemAlloc_v2(&memory, bytes)) return error;
    *array = reinterpret_cast<CUarray>(memory);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuArrayDestroy(CUarray array) {
    if (CUresult error = require_init()) return error;
    if (array == nullptr) return CUDA_ERROR_INVALID_HANDLE;
    const CUresult error = cuMemFree_v2(address_of(array, 0));
    return error == CUDA_ERROR_INVALID_VALUE ? CUDA_ERROR_INVALID_HANDLE : error;
}

SIMGPU_API CUresult cuMipmappedArrayCreate(CUmipmappedArray* handle,
                                           const CUDA_ARRAY3D_DESCRIPTOR* shape,
                                           unsigned num_levels) {
    Context* context = nullptr;
    if (CUresult error = current_context(context)) return error;
    if (handle == nullptr || shape == nullptr || shape->Width == 0 || num_levels == 0 ||
        bytes_of(shape->Format) == 0)
        return CUDA_ERROR_INVALID_VALUE;
    const auto longest = std::max({shape->Width, shape->Height, shape->Depth});
    const auto array = std::make_shared<MipmappedArray>();
    array->context = context->owner();
    std::size_t bytes = kLevelAlignment;
    for (int i = 0;
         i < static_cast<int>(std::min<std::size_t>(num_levels, std::bit_width(longest))); ++i) {
        array->levels.push_back(bytes);
        const auto extent = [i](std::size_t whole) { return std::max<std::size_t>(whole >> i, 1); };
        bytes += extent(shape->Width) * extent(shape->Height) * extent(shape->Depth) *
                 bytes_of(shape->Format) * shape->NumChannels;
        bytes = (bytes + kLevelAlignment - 1) / kLevelAlignment * kLevelAlignment;
    }
    if (CUresult error = cuMemAlloc_v2(&array->memory, bytes)) return error;
    for (CUdeviceptr& level : array->levels) level += array->memory;
    *handle = driver().mipmapped_arrays.add(array);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuMipmappedArrayGetLevel(CUarray* array, CUmipmappedArray handle,
                                             unsigned level) {
    if (CUresult error = require_init()) return error;
    const auto its = driver().mipmapped_arrays.find(handle);
    if (!its) return CUDA_ERROR_INVALID_HANDLE;
    if (array == nullptr || level >= its->levels.size()) return CUDA_ERROR_INVALID_VALUE;
    *array = reinterpret_cast<CUarray>(its->levels[level]);
    return CUDA_SUCCESS;
}

SIMGPU_API CUresult cuMipmappedArrayDestroy(CUmipmappedArray handle) {
    if (CUresult error = require_init()) return error;
    const auto its = driver().mipmapped_arrays.find(handle);
    if (!its) return CUDA_ERROR_INVALID_HANDLE;
    if (CUresult error = cuMemFree_v2(its->memory)) return error;
    driver().mipmapped_arrays.remove(handle);
    return CUDA_SUCCESS;
}

// Each in both flavours of the default stream.
#define SIMGPU_ARRAY_COPIES(suffix, stream)                                                        \
    SIMGPU_API CUresult cuMemcpyAtoH_v2##suffix(void* to, CUarray from, std::size_t offset,        \
                                                std::size_t bytes) {                               \
        return to_host(to, from, offset, bytes, stream, true);                                     \
    }                                                                                              \
    SIMGPU_API CUresult cuMemcpyHtoA_v2##suffix(CUarray to, std::size_t offset, const void* from,  \
                                                std::size_t bytes) {                               \
        return from_host(to, offset, from, bytes, stream, true);                                   \
    }                                                                                              \
    SIMGPU_API CUresult cuMemcpyAtoD_v2##suffix(CUdeviceptr to, CUarray from, std::size_t offset,  \
                                                std::size_t bytes) {                               \
        return on_device(to, address_of(from, offset), bytes, stream);                             \
    }                                                                                              \
    SIMGPU_API CUresult cuMemcpyDtoA_v2##suffix(CUarray to, std::size_t offset, CUdeviceptr from,  \
                                                std::size_t bytes) {                               \
        return on_device(address_of(to, offset), from, bytes, stream);                             \
    }                                                                                              \
    SIMGPU_API CUresult cuMemcpyAtoA_v2##suffix(CUarray to, std::size_t to_offset, CUarray from,   \
                                                std::size_t from_offset, std::size_t bytes) {      \
        return on_device(address_of(to, to_offset), address_of(from, from_offset), bytes, stream); \
    }
SIMGPU_ARRAY_COPIES(, CU_STREAM_LEGACY)
SIMGPU_ARRAY_COPIES(_ptds, CU_STREAM_PER_THREAD)
#undef SIMGPU_ARRAY_COPIES

SIMGPU_API CUresult cuMemcpyAtoHAsync_v2(void* to, CUarray from, std::size_t offset,
                                         std::size_t bytes, CUstream stream) {
    return to_host(to, from, offset, bytes, stream, false);
}

SIMGPU_API CUresult cuMemcpyAtoHAsync_v2_ptsz(void* to, CUarray from, std::size_t offset,
                                              std::size_t bytes, CUstream stream) {
    return to_host(to, from, offset, bytes, per_thread_if_null(stream), false);
}

SIMGPU_API CUresult cuMemcpyHtoAAsync_v2(CUarray to, std::size_t offset, const void* from,
                                         std::size_t bytes, CUstream stream) {
    return from_host(to, offset, from, bytes, stream, false);
}

SIMGPU_API CUresult cuMemcpyHtoAAsync_v2_ptsz(CUarray to, std::size_t offset, const void* from,
                                              std::size_t bytes, CUstream stream) {
    return from_host(to, offset, from, bytes, per_thread_if_null(stream), false);
}
