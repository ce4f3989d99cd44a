// SPDX-License-Identifier: Apache-2.0
//
// Copies and memsets on a given stream, for the entry points of both default-stream flavours.
#pragma once

#include <cstddef>

#include "tools/simgpu/api/driver_state.h"

namespace urgengo::simgpu {

enum class CopyKind { kHostToDevice, kDeviceToHost, kDeviceToDevice, kFromPointers };

struct CopyRequest {
    std::uintptr_t to;
    std::uintptr_t from;
    std::size_t bytes;
    CopyKind kind;
    CUstream stream;
    bool waits;  ///< whether the caller waits for a copy that involves the host
};

CUresult copy(CopyRequest request);

/// The work of setting rows of elements, `pitch` bytes apart.
CUresult make_memset(CUdeviceptr to, std::uint32_t value, std::size_t element_bytes,
                     std::size_t width, std::size_t height, std::size_t pitch, CopyWork& work);

/// Sets `count` elements of `element_bytes` each, without waiting.
CUresult memset(CUdeviceptr to, std::uint32_t value, std::size_t element_bytes, std::size_t count,
                CUstream stream);

}  // namespace urgengo::simgpu
