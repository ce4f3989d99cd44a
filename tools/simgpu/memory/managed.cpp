// SPDX-License-Identifier: Apache-2.0
//
// What programs say of managed memory. It is the host's here, so there is nothing to move: the
// calls take their place on the stream.
#include "tools/simgpu/api/driver_state.h"

using namespace urgengo::simgpu;

namespace {

CUresult take_place(CUdeviceptr address, std::size_t bytes, CUstream handle) {
    std::shared_ptr<Stream> stream;
    if (CUresult error = resolve_stream_for_work(handle, stream)) return error;
    const auto allocation = driver().memory.find(address);
    const bool managed = allocation && allocation->kind == Allocation::Kind::kManaged &&
                         bytes <= allocation->base + allocation->bytes - address;
    if (!managed) return CUDA_ERROR_INVALID_VALUE;
    submit(*stream, TimedWork{});
    return CUDA_SUCCESS;
}

}  // namespace

SIMGPU_API CUresult cuStreamAttachMemAsync(CUstream stream, CUdeviceptr address, std::size_t bytes,
                                           unsigned flags) {
    const bool known = flags == CU_MEM_ATTACH_GLOBAL || flags == CU_MEM_ATTACH_HOST ||
                       flags == CU_MEM_ATTACH_SINGLE;
    return known ? take_place(address, bytes, stream) : CUDA_ERROR_INVALID_VALUE;
}

SIMGPU_API CUresult cuStreamAttachMemAsync_ptsz(CUstream stream, CUdeviceptr address,
                                                std::size_t bytes, unsigned flags) {
    return cuStreamAttachMemAsync(per_thread_if_null(stream), address, bytes, flags);
}

SIMGPU_API CUresult cuMemPrefetchAsync(CUdeviceptr address, std::size_t bytes, CUdevice device,
                                       CUstream stream) {
    return take_place(address, bytes, stream);
}

SIMGPU_API CUresult cuMemPrefetchAsync_ptsz(CUdeviceptr address, std::size_t bytes, CUdevice device,
                                            CUstream stream) {
    return take_place(address, bytes, per_thread_if_null(stream));
}

SIMGPU_API CUresult cuMemPrefetchAsync_v2(CUdeviceptr address, std::size_t bytes,
                                          CUmemLocation location, unsigned flags, CUstream stream) {
    return flags == 0 ? take_place(address, bytes, stream) : CUDA_ERROR_INVALID_VALUE;
}

SIMGPU_API CUresult cuMemPrefetchAsync_v2_ptsz(CUdeviceptr address, std::size_t bytes,
                                               CUmemLocation location, unsigned flags,
                                               CUstream stream) {
    return cuMemPrefetchAsync_v2(address, bytes, location, flags, per_thread_if_null(stream));
}
