// SPDX-License-Identifier: Apache-2.0
//
// What a dispatcher asks of the driver when it is set up, and gets.
#pragma once

#include "host/exec/driver_api.h"

namespace urgengo::testing {

inline constexpr int kSharedBytes = 228 << 10;  ///< of a multiprocessor

/// Without streams, gates, contexts and launches: those are the test's.
inline void let_dispatcher_be_set_up(exec::DriverApi& api) {
    api.cuDeviceGetAttribute = [](int* value, CUdevice_attribute, CUdevice) {
        *value = kSharedBytes;
        return CUDA_SUCCESS;
    };
    api.cuMemAlloc_v2 = [](CUdeviceptr* address, std::size_t) {
        *address = 0x2000;
        return CUDA_SUCCESS;
    };
    api.cuMemsetD8Async = [](CUdeviceptr, unsigned char, std::size_t, CUstream) {
        return CUDA_SUCCESS;
    };
    api.cuMemHostRegister_v2 = [](void*, std::size_t, unsigned) { return CUDA_SUCCESS; };
    api.cuMemHostGetDevicePointer_v2 = [](CUdeviceptr* address, void* host, unsigned) {
        *address = reinterpret_cast<CUdeviceptr>(host);
        return CUDA_SUCCESS;
    };
    api.cuStreamSynchronize = [](CUstream) { return CUDA_SUCCESS; };
    api.cuModuleLoadData = [](CUmodule*, const void*) { return CUDA_SUCCESS; };
}

}  // namespace urgengo::testing
