// SPDX-License-Identifier: Apache-2.0
//
// What a fake driver says of memory: one allocation of the host's, one of the GPU's.
#pragma once

#include <cstddef>

#include "host/exec/driver_api.h"

namespace urgengo::testing {

inline constexpr std::size_t kMiB = 1 << 20, kMemory = 1024 * kMiB;
/// Where they begin; each has kMemory bytes.
inline constexpr CUdeviceptr kHost = 0x20'0000'0000, kDevice = 0x10'0000'0000;

inline void answer_of_memory(exec::DriverApi& api) {
    api.cuPointerGetAttribute = [](void* answer, CUpointer_attribute what, CUdeviceptr at) {
        if (what == CU_POINTER_ATTRIBUTE_MEMORY_TYPE)
            *static_cast<unsigned*>(answer) =
                at >= kHost ? CU_MEMORYTYPE_HOST : CU_MEMORYTYPE_DEVICE;
        else if (what == CU_POINTER_ATTRIBUTE_RANGE_START_ADDR)
            *static_cast<CUdeviceptr*>(answer) = kHost;
        else if (what == CU_POINTER_ATTRIBUTE_RANGE_SIZE)
            *static_cast<std::size_t*>(answer) = kMemory;
        else
            *static_cast<int*>(answer) = 0;
        return CUDA_SUCCESS;
    };
    api.cuMemGetAddressRange_v2 = [](CUdeviceptr* begin, std::size_t* bytes, CUdeviceptr) {
        *begin = kDevice;
        *bytes = kMemory;
        return CUDA_SUCCESS;
    };
}

}  // namespace urgengo::testing
