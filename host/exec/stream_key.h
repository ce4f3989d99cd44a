// SPDX-License-Identifier: Apache-2.0
//
// What tells streams apart: a handle does, but default streams have one in all contexts or threads.
#pragma once

#include "host/exec/driver_api.h"

namespace urgengo::exec {

struct StreamKey {
    CUstream stream;
    const void* scope;  ///< legacy: the context; per-thread: something of the thread's; else null
    bool operator==(const StreamKey&) const = default;
};

inline bool is_per_thread(CUstream stream, StreamFlavor flavor) {
    return stream == CU_STREAM_PER_THREAD || (!stream && flavor == StreamFlavor::kPerThread);
}

inline StreamKey stream_key(const DriverApi& driver, CUstream stream, StreamFlavor flavor) {
    if (!is_default_stream(stream)) return {stream, nullptr};
    static thread_local const char t_thread = 0;
    if (is_per_thread(stream, flavor)) return {CU_STREAM_PER_THREAD, &t_thread};
    CUcontext context = nullptr;
    if (driver.cuCtxGetCurrent(&context) != CUDA_SUCCESS) context = nullptr;
    return {CU_STREAM_LEGACY, context};
}

}  // namespace urgengo::exec
