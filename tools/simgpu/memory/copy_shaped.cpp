// SPDX-License-Identifier: Apache-2.0
//
// Copies of rows and boxes, memsets of rows, copies between contexts, and several copies in one
// call: what programs use beside the linear ones of copy.cpp.
#include <cstring>
#include <vector>

#include "tools/simgpu/memory/copy.h"

using namespace urgengo::simgpu;

namespace {

struct Box {
    std::size_t width_bytes, height, depth;
};

/// Where a box lies: rows `pitch` bytes apart, slices `slice` bytes.
struct Side {
    std::uintptr_t start;
    std::size_t pitch, slice;

    std::uintptr_t row(std::size_t y, std::size_t z) const { return start + z * slice + y * pitch; }
};

/// A side that begins in memory that the driver knows must end in the same allocation.
/// @returns whether the driver knows it
CUresult check_side(const Side& side, const Box& box, bool& known) {
    const auto allocation = driver().memory.find(side.start);
    known = allocation.has_value();
    if (!known) return CUDA_SUCCESS;
    const std::uintptr_t end = side.row(box.height - 1, box.depth - 1) + box.width_bytes;
    return end <= allocation->base + allocation->bytes ? CUDA_SUCCESS : CUDA_ERROR_INVALID_VALUE;
}

CUresult copy_box(const Side& to, const Side& from, const Box& box, CUstream handle, bool waits) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream_for_work(handle, stream)) return error;
    if (box.width_bytes == 0 || box.height == 0 || box.depth == 0) return CUDA_SUCCESS;
    const auto too_narrow = [&box](const Side& side) {
        return (box.height > 1 || box.depth > 1) && side.pitch < box.width_bytes;
    };
    if (to.start == 0 || from.start == 0 || too_narrow(to) || too_narrow(from))
        return CUDA_ERROR_INVALID_VALUE;
    bool to_known = false;
    bool from_known = false;
    if (CUresult error = check_side(to, box, to_known)) return error;
    if (CUresult error = check_side(from, box, from_known)) return error;
    const Part& part = driver().part;
    CopyWork work{
        .engine = CopyEngine::kOnDevice,
        .duration = part.copy_time(box.width_bytes * box.height * box.depth, part.copy_gbps),
        .run =
            [to, from, box] {
                for (std::size_t z = 0; z < box.depth; ++z)
                    for (std::size_t y = 0; y < box.height; ++y)
                        std::memmove(reinterpret_cast<void*>(to.row(y, z)),
                                     reinterpret_cast<const void*>(from.row(y, z)),
                                     box.width_bytes);
            },
        .writes = {to.start, to.row(box.height - 1, box.depth - 1) + box.width_bytes - to.start},
    };
    const Fence done = submit(*stream, std::move(work));
    // The program's own memory is read and written before the call returns.
    if (waits || !to_known || !from_known) done.wait();
    return CUDA_SUCCESS;
}

CUresult start_of(CUmemorytype type, const void* host, CUdeviceptr device, std::uintptr_t& start) {
    if (type == CU_MEMORYTYPE_ARRAY) return CUDA_ERROR_NOT_SUPPORTED;
    start = type == CU_MEMORYTYPE_HOST ? reinterpret_cast<std::uintptr_t>(host) : device;
    return CUDA_SUCCESS;
}

CUresult copy_rows(const CUDA_MEMCPY2D* shape, CUstream stream, bool waits) {
    if (shape == nullptr) return CUDA_ERROR_INVALID_VALUE;
    Side to{0, shape->dstPitch, 0};
    Side from{0, shape->srcPitch, 0};
    if (CUresult error = start_of(shape->dstMemoryType, shape->dstHost, shape->dstDevice, to.start))
        return error;
    if (CUresult error =
            start_of(shape->srcMemoryType, shape->srcHost, shape->srcDevice, from.start))
        return error;
    to.start += shape->dstXInBytes + shape->dstY * to.pitch;
    from.start += shape->srcXInBytes + shape->srcY * from.pitch;
    return copy_box(to, from, {shape->WidthInBytes, shape->Height, 1}, stream, waits);
}

/// CUDA_MEMCPY3D and CUDA_MEMCPY3D_PEER alike: there is one device, and addresses are its own.
template <typename Shape>
CUresult copy_shape(const Shape* shape, CUstream stream, bool waits) {
    if (shape == nullptr) return CUDA_ERROR_INVALID_VALUE;
    Side to{0, shape->dstPitch, shape->dstPitch * shape->dstHeight};
    Side from{0, shape->srcPitch, shape->srcPitch * shape->srcHeight};
    if (CUresult error = start_of(shape->dstMemoryType, shape->dstHost, shape->dstDevice, to.start))
        return error;
    if (CUresult error =
            start_of(shape->srcMemoryType, shape->srcHost, shape->srcDevice, from.start))
        return error;
    to.start += shape->dstXInBytes + shape->dstY * to.pitch + shape->dstZ * to.slice;
    from.start += shape->srcXInBytes + shape->srcY * from.pitch + shape->srcZ * from.slice;
    return copy_box(to, from, {shape->WidthInBytes, shape->Height, shape->Depth}, stream, waits);
}

CUresult set_rows(CUdeviceptr to, std::size_t pitch, std::uint32_t value, std::size_t element_bytes,
                  std::size_t width, std::size_t height, CUstream handle) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream_for_work(handle, stream)) return error;
    if (width == 0 || height == 0) return CUDA_SUCCESS;
    if (height > 1 && pitch < width * element_bytes) return CUDA_ERROR_INVALID_VALUE;
    CopyWork work{};
    if (CUresult error = make_memset(to, value, element_bytes, width, height, pitch, work))
        return error;
    submit(*stream, std::move(work));
    return CUDA_SUCCESS;
}

CUresult copy_between(CUdeviceptr to, CUcontext to_context, CUdeviceptr from,
                      CUcontext from_context, std::size_t bytes, CUstream stream) {
    if (to_context == nullptr || from_context == nullptr) return CUDA_ERROR_INVALID_VALUE;
    return copy({to, from, bytes, CopyKind::kDeviceToDevice, stream, false});
}

CUresult copy_batch(const CUdeviceptr* to, const CUdeviceptr* from, const std::size_t* sizes,
                    std::size_t count, CUstream stream, std::size_t* failed) {
    constexpr auto kNone = static_cast<std::size_t>(-1);
    if (failed != nullptr) *failed = kNone;
    const bool named = stream != nullptr && stream != CU_STREAM_LEGACY;
    if (to == nullptr || from == nullptr || sizes == nullptr || count == 0 || !named)
        return CUDA_ERROR_INVALID_VALUE;
    for (std::size_t i = 0; i < count; ++i) {
        if (CUresult error =
                copy({to[i], from[i], sizes[i], CopyKind::kFromPointers, stream, false})) {
            if (failed != nullptr) *failed = i;
            return error;
        }
    }
    return CUDA_SUCCESS;
}

}  // namespace

// Each in both flavours of the default stream.
#define SIMGPU_COPY_NOW(name, Shape, function)              \
    SIMGPU_API CUresult name(const Shape* shape) {          \
        return function(shape, CU_STREAM_LEGACY, true);     \
    }                                                       \
    SIMGPU_API CUresult name##_ptds(const Shape* shape) {   \
        return function(shape, CU_STREAM_PER_THREAD, true); \
    }
#define SIMGPU_COPY_ASYNC(name, Shape, function)                           \
    SIMGPU_API CUresult name(const Shape* shape, CUstream stream) {        \
        return function(shape, stream, false);                             \
    }                                                                      \
    SIMGPU_API CUresult name##_ptsz(const Shape* shape, CUstream stream) { \
        return function(shape, per_thread_if_null(stream), false);         \
    }
SIMGPU_COPY_NOW(cuMemcpy2D_v2, CUDA_MEMCPY2D, copy_rows)
SIMGPU_COPY_NOW(cuMemcpy2DUnaligned_v2, CUDA_MEMCPY2D, copy_rows)
SIMGPU_COPY_NOW(cuMemcpy3D_v2, CUDA_MEMCPY3D, copy_shape)
SIMGPU_COPY_NOW(cuMemcpy3DPeer, CUDA_MEMCPY3D_PEER, copy_shape)
SIMGPU_COPY_ASYNC(cuMemcpy2DAsync_v2, CUDA_MEMCPY2D, copy_rows)
SIMGPU_COPY_ASYNC(cuMemcpy3DAsync_v2, CUDA_MEMCPY3D, copy_shape)
SIMGPU_COPY_ASYNC(cuMemcpy3DPeerAsync, CUDA_MEMCPY3D_PEER, copy_shape)
#undef SIMGPU_COPY_NOW
#undef SIMGPU_COPY_ASYNC

#define SIMGPU_SET_ROWS(name, now, Value)                                                          \
    SIMGPU_API CUresult now(CUdeviceptr to, std::size_t pitch, Value value, std::size_t width,     \
                            std::size_t height) {                                                  \
        return set_rows(to, pitch, value, sizeof value, width, height, CU_STREAM_LEGACY);          \
    }                                                                                              \
    SIMGPU_API CUresult now##_ptds(CUdeviceptr to, std::size_t pitch, Value value,                 \
                                   std::size_t width, std::size_t height) {                        \
        return set_rows(to, pitch, value, sizeof value, width, height, CU_STREAM_PER_THREAD);      \
    }                                                                                              \
    SIMGPU_API CUresult name##Async(CUdeviceptr to, std::size_t pitch, Value value,                \
                                    std::size_t width, std::size_t height, CUstream stream) {      \
        return set_rows(to, pitch, value, sizeof value, width, height, stream);                    \
    }                                                                                              \
    SIMGPU_API CUresult name##Async_ptsz(CUdeviceptr to, std::size_t pitch, Value value,           \
                                         std::size_t width, std::size_t height, CUstream stream) { \
        return set_rows(to, pitch, value, sizeof value, width, height,                             \
                        per_thread_if_null(stream));                                               \
    }
SIMGPU_SET_ROWS(cuMemsetD2D8, cuMemsetD2D8_v2, unsigned char)
SIMGPU_SET_ROWS(cuMemsetD2D16, cuMemsetD2D16_v2, unsigned short)
SIMGPU_SET_ROWS(cuMemsetD2D32, cuMemsetD2D32_v2, unsigned)
#undef SIMGPU_SET_ROWS

SIMGPU_API CUresult cuMemcpyPeer(CUdeviceptr to, CUcontext to_context, CUdeviceptr from,
                                 CUcontext from_context, std::size_t bytes) {
    return copy_between(to, to_context, from, from_context, bytes, CU_STREAM_LEGACY);
}

SIMGPU_API CUresult cuMemcpyPeer_ptds(CUdeviceptr to, CUcontext to_context, CUdeviceptr from,
                                      CUcontext from_context, std::size_t bytes) {
    return copy_between(to, to_context, from, from_context, bytes, CU_STREAM_PER_THREAD);
}

SIMGPU_API CUresult cuMemcpyPeerAsync(CUdeviceptr to, CUcontext to_context, CUdeviceptr from,
                                      CUcontext from_context, std::size_t bytes, CUstream stream) {
    return copy_between(to, to_context, from, from_context, bytes, stream);
}

SIMGPU_API CUresult cuMemcpyPeerAsync_ptsz(CUdeviceptr to, CUcontext to_context, CUdeviceptr from,
                                           CUcontext from_context, std::size_t bytes,
                                           CUstream stream) {
    return copy_between(to, to_context, from, from_context, bytes, per_thread_if_null(stream));
}

// The attributes say how the copies may be done, not what they do.
#if CUDA_VERSION < 12080
struct CUmemcpyAttributes;
#endif
SIMGPU_API CUresult cuMemcpyBatchAsync(CUdeviceptr* to, CUdeviceptr* from, std::size_t* sizes,
                                       std::size_t count, CUmemcpyAttributes* attributes,
                                       std::size_t* indices, std::size_t num_attributes,
                                       std::size_t* failed, CUstream stream) {
    return copy_batch(to, from, sizes, count, stream, failed);
}

SIMGPU_API CUresult cuMemcpyBatchAsync_ptsz(CUdeviceptr* to, CUdeviceptr* from, std::size_t* sizes,
                                            std::size_t count, CUmemcpyAttributes* attributes,
                                            std::size_t* indices, std::size_t num_attributes,
                                            std::size_t* failed, CUstream stream) {
    return copy_batch(to, from, sizes, count, stream, failed);
}

SIMGPU_API CUresult cuMemcpyBatchAsync_v2(CUdeviceptr* to, CUdeviceptr* from, std::size_t* sizes,
                                          std::size_t count, CUmemcpyAttributes* attributes,
                                          std::size_t* indices, std::size_t num_attributes,
                                          CUstream stream) {
    return copy_batch(to, from, sizes, count, stream, nullptr);
}

SIMGPU_API CUresult cuMemcpyBatchAsync_v2_ptsz(CUdeviceptr* to, CUdeviceptr* from,
                                               std::size_t* sizes, std::size_t count,
                                               CUmemcpyAttributes* attributes, std::size_t* indices,
                                               std::size_t num_attributes, CUstream stream) {
    return copy_batch(to, from, sizes, count, stream, nullptr);
}
