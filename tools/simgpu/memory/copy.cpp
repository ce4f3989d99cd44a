// SPDX-License-Identifier: Apache-2.0
//
// Copies and memsets: really done, by the engine, when their simulated time is over.
//
// Pageable host memory is special, as with the driver: a copy from it has read its source when the
// call returns, a copy to it is done when the call returns, asynchronous or not.
#include "tools/simgpu/memory/copy.h"

#include <algorithm>
#include <cstring>
#include <vector>

#include "tools/simgpu/graph/capture.h"

namespace urgengo::simgpu {
namespace {

/// @returns whether the driver knows all of the range
bool is_known(const std::optional<Allocation>& allocation, std::uintptr_t begin,
              std::size_t bytes) {
    return allocation && bytes <= allocation->base + allocation->bytes - begin;
}

CopyKind kind_of(const std::optional<Allocation>& to, const std::optional<Allocation>& from) {
    const bool to_device = to && to->on_device();
    const bool from_device = from && from->on_device();
    if (to_device && from_device) return CopyKind::kDeviceToDevice;
    return from_device ? CopyKind::kDeviceToHost : CopyKind::kHostToDevice;
}

CopyEngine engine_of(CopyKind kind) {
    switch (kind) {
        case CopyKind::kDeviceToHost:
            return CopyEngine::kDeviceToHost;
        case CopyKind::kDeviceToDevice:
            return CopyEngine::kOnDevice;
        default:
            return CopyEngine::kHostToDevice;
    }
}

template <typename T>
void fill(CUdeviceptr to, std::uint32_t value, std::size_t count) {
    std::fill_n(reinterpret_cast<T*>(to), count, static_cast<T>(value));
}

}  // namespace

CUresult copy(CopyRequest request) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream_for_work(request.stream, stream)) return error;
    if (request.waits) {
        if (CUresult error = require_safe_call()) return error;
    }
    if (request.bytes == 0) return CUDA_SUCCESS;
    if (request.to == 0 || request.from == 0) return CUDA_ERROR_INVALID_VALUE;

    const auto to = driver().memory.find(request.to);
    const auto from = driver().memory.find(request.from);
    const bool to_known = is_known(to, request.to, request.bytes);
    const bool from_known = is_known(from, request.from, request.bytes);
    // A range that begins in known memory must end there; one that does not begin there is the
    // program's own host memory, which is allowed where the call says "host" or does not say.
    const bool to_needs_device =
        request.kind == CopyKind::kHostToDevice || request.kind == CopyKind::kDeviceToDevice;
    const bool from_needs_device =
        request.kind == CopyKind::kDeviceToHost || request.kind == CopyKind::kDeviceToDevice;
    if (!to_known && (to || to_needs_device)) return CUDA_ERROR_INVALID_VALUE;
    if (!from_known && (from || from_needs_device)) return CUDA_ERROR_INVALID_VALUE;
    if (request.kind == CopyKind::kFromPointers) request.kind = kind_of(to, from);

    const bool waits = !to_known || (request.waits && request.kind != CopyKind::kDeviceToDevice);
    std::shared_ptr<std::vector<std::byte>> staged;
    // A node of a graph reads its source when the graph runs.
    if (!from_known && !waits && !is_capturing(*stream)) {
        const auto* source = reinterpret_cast<const std::byte*>(request.from);
        staged = std::make_shared<std::vector<std::byte>>(source, source + request.bytes);
        request.from = reinterpret_cast<std::uintptr_t>(staged->data());
    }

    const Part& part = driver().part;
    const bool on_device = request.kind == CopyKind::kDeviceToDevice && to->device == from->device;
    CopyWork work{
        .engine = engine_of(request.kind),
        .duration = part.copy_time(request.bytes, on_device ? part.device_gbps : part.copy_gbps),
        .run =
            [request, staged] {
                std::memmove(reinterpret_cast<void*>(request.to),
                             reinterpret_cast<const void*>(request.from), request.bytes);
            },
        .writes = {request.to, request.bytes},
    };
    const Fence done = submit(*stream, std::move(work));
    if (!waits) return CUDA_SUCCESS;
    done.wait();
    return stream->context->broken;
}

CUresult make_memset(CUdeviceptr to, std::uint32_t value, std::size_t element_bytes,
                     std::size_t width, std::size_t height, std::size_t pitch, CopyWork& work) {
    const bool known_size = element_bytes == 1 || element_bytes == 2 || element_bytes == 4;
    if (!known_size || to % element_bytes != 0 || width > SIZE_MAX / element_bytes || width == 0 ||
        height == 0) {
        return CUDA_ERROR_INVALID_VALUE;
    }
    const std::size_t row_bytes = width * element_bytes;
    const std::size_t bytes = (height - 1) * pitch + row_bytes;
    if (!is_known(driver().memory.find(to), to, bytes)) return CUDA_ERROR_INVALID_VALUE;
    work = {
        .engine = CopyEngine::kOnDevice,
        .duration = driver().part.copy_time(row_bytes * height, driver().part.device_gbps),
        .run =
            [to, value, element_bytes, width, height, pitch] {
                for (std::size_t row = 0; row < height; ++row) {
                    const CUdeviceptr start = to + row * pitch;
                    switch (element_bytes) {
                        case 1:
                            fill<std::uint8_t>(start, value, width);
                            break;
                        case 2:
                            fill<std::uint16_t>(start, value, width);
                            break;
                        default:
                            fill<std::uint32_t>(start, value, width);
                    }
                }
            },
        .writes = {to, bytes},
        .is_memset = true,
    };
    return CUDA_SUCCESS;
}

CUresult memset(CUdeviceptr to, std::uint32_t value, std::size_t element_bytes, std::size_t count,
                CUstream handle) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream_for_work(handle, stream)) return error;
    if (count == 0) return CUDA_SUCCESS;
    CopyWork work{};
    if (CUresult error = make_memset(to, value, element_bytes, count, 1, 0, work)) return error;
    submit(*stream, std::move(work));
    return CUDA_SUCCESS;
}

}  // namespace urgengo::simgpu

using namespace urgengo::simgpu;

SIMGPU_API CUresult cuMemcpy(CUdeviceptr to, CUdeviceptr from, std::size_t bytes) {
    return copy({to, from, bytes, CopyKind::kFromPointers, CU_STREAM_LEGACY, true});
}

SIMGPU_API CUresult cuMemcpyAsync(CUdeviceptr to, CUdeviceptr from, std::size_t bytes,
                                  CUstream stream) {
    return copy({to, from, bytes, CopyKind::kFromPointers, stream, false});
}

SIMGPU_API CUresult cuMemcpyHtoD_v2(CUdeviceptr to, const void* from, std::size_t bytes) {
    return copy({to, reinterpret_cast<std::uintptr_t>(from), bytes, CopyKind::kHostToDevice,
                 CU_STREAM_LEGACY, true});
}

SIMGPU_API CUresult cuMemcpyHtoDAsync_v2(CUdeviceptr to, const void* from, std::size_t bytes,
                                         CUstream stream) {
    return copy({to, reinterpret_cast<std::uintptr_t>(from), bytes, CopyKind::kHostToDevice, stream,
                 false});
}

SIMGPU_API CUresult cuMemcpyDtoH_v2(void* to, CUdeviceptr from, std::size_t bytes) {
    return copy({reinterpret_cast<std::uintptr_t>(to), from, bytes, CopyKind::kDeviceToHost,
                 CU_STREAM_LEGACY, true});
}

SIMGPU_API CUresult cuMemcpyDtoHAsync_v2(void* to, CUdeviceptr from, std::size_t bytes,
                                         CUstream stream) {
    return copy({reinterpret_cast<std::uintptr_t>(to), from, bytes, CopyKind::kDeviceToHost, stream,
                 false});
}

SIMGPU_API CUresult cuMemcpyDtoD_v2(CUdeviceptr to, CUdeviceptr from, std::size_t bytes) {
    return copy({to, from, bytes, CopyKind::kDeviceToDevice, CU_STREAM_LEGACY, true});
}

SIMGPU_API CUresult cuMemcpyDtoDAsync_v2(CUdeviceptr to, CUdeviceptr from, std::size_t bytes,
                                         CUstream stream) {
    return copy({to, from, bytes, CopyKind::kDeviceToDevice, stream, false});
}

SIMGPU_API CUresult cuMemsetD8_v2(CUdeviceptr to, unsigned char value, std::size_t count) {
    return memset(to, value, 1, count, CU_STREAM_LEGACY);
}

SIMGPU_API CUresult cuMemsetD16_v2(CUdeviceptr to, unsigned short value, std::size_t count) {
    return memset(to, value, 2, count, CU_STREAM_LEGACY);
}

SIMGPU_API CUresult cuMemsetD32_v2(CUdeviceptr to, unsigned value, std::size_t count) {
    return memset(to, value, 4, count, CU_STREAM_LEGACY);
}

SIMGPU_API CUresult cuMemsetD8Async(CUdeviceptr to, unsigned char value, std::size_t count,
                                    CUstream stream) {
    return memset(to, value, 1, count, stream);
}

SIMGPU_API CUresult cuMemsetD16Async(CUdeviceptr to, unsigned short value, std::size_t count,
                                     CUstream stream) {
    return memset(to, value, 2, count, stream);
}

SIMGPU_API CUresult cuMemsetD32Async(CUdeviceptr to, unsigned value, std::size_t count,
                                     CUstream stream) {
    return memset(to, value, 4, count, stream);
}
