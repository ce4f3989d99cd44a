// SPDX-License-Identifier: Apache-2.0
//
// Launches as they were before cuLaunchKernel, which keep the block's shape and the parameters with
// the function, and the cooperative one for several devices, of which there is one here.
#include <cstring>
#include <map>
#include <mutex>
#include <vector>

#include "tools/simgpu/image/function.h"

using namespace urgengo::simgpu;

namespace {

struct OldLaunch {
    unsigned x = 1, y = 1, z = 1;
    unsigned shared_bytes = 0;
    std::vector<std::byte> params;
};

std::mutex g_mutex;
std::map<CUfunction, OldLaunch> g_launches;

CUresult change(CUfunction function, void (*what)(OldLaunch&, const void*), const void* arguments) {
    if (CUresult error = require_init()) return error;
    if (!find_function(function)) return CUDA_ERROR_INVALID_HANDLE;
    const std::lock_guard lock(g_mutex);
    what(g_launches[function], arguments);
    return CUDA_SUCCESS;
}

CUresult set_param(CUfunction function, int offset, const void* value, std::size_t bytes) {
    struct Param {
        int offset;
        const void* value;
        std::size_t bytes;
    };
    if (offset < 0 || value == nullptr) return CUDA_ERROR_INVALID_VALUE;
    const Param param{offset, value, bytes};
    return change(
        function,
        [](OldLaunch& launch, const void* arguments) {
            const auto& its = *static_cast<const Param*>(arguments);
            const auto begin = static_cast<std::size_t>(its.offset);
            if (launch.params.size() < begin + its.bytes) launch.params.resize(begin + its.bytes);
            std::memcpy(launch.params.data() + begin, its.value, its.bytes);
        },
        &param);
}

CUresult launch(CUfunction function, int width, int height, CUstream stream) {
    if (CUresult error = require_init()) return error;
    if (width <= 0 || height <= 0) return CUDA_ERROR_INVALID_VALUE;
    OldLaunch its;
    {
        const std::lock_guard lock(g_mutex);
        if (const auto found = g_launches.find(function); found != g_launches.end())
            its = found->second;
    }
    std::size_t bytes = its.params.size();
    void* extra[] = {CU_LAUNCH_PARAM_BUFFER_POINTER, its.params.data(), CU_LAUNCH_PARAM_BUFFER_SIZE,
                     &bytes, CU_LAUNCH_PARAM_END};
    return cuLaunchKernel(function, static_cast<unsigned>(width), static_cast<unsigned>(height), 1,
                          its.x, its.y, its.z, its.shared_bytes, stream, nullptr,
                          bytes == 0 ? nullptr : extra);
}

}  // namespace

SIMGPU_API CUresult cuFuncSetBlockShape(CUfunction function, int x, int y, int z) {
    if (x <= 0 || y <= 0 || z <= 0) return CUDA_ERROR_INVALID_VALUE;
    const int shape[] = {x, y, z};
    return change(
        function,
        [](OldLaunch& its, const void* arguments) {
            const auto* const size = static_cast<const int*>(arguments);
            its.x = static_cast<unsigned>(size[0]);
            its.y = static_cast<unsigned>(size[1]);
            its.z = static_cast<unsigned>(size[2]);
        },
        shape);
}

SIMGPU_API CUresult cuFuncSetSharedSize(CUfunction function, unsigned bytes) {
    return change(
        function,
        [](OldLaunch& its, const void* size) {
            its.shared_bytes = *static_cast<const unsigned*>(size);
        },
        &bytes);
}

SIMGPU_API CUresult cuParamSetSize(CUfunction function, unsigned bytes) {
    return change(
        function,
        [](OldLaunch& its, const void* size) {
            its.params.resize(*static_cast<const unsigned*>(size));
        },
        &bytes);
}

SIMGPU_API CUresult cuParamSeti(CUfunction function, int offset, unsigned value) {
    return set_param(function, offset, &value, sizeof value);
}

SIMGPU_API CUresult cuParamSetv(CUfunction function, int offset, void* value, unsigned bytes) {
    return set_param(function, offset, value, bytes);
}

SIMGPU_API CUresult cuLaunch(CUfunction function) {
    return launch(function, 1, 1, CU_STREAM_LEGACY);
}

SIMGPU_API CUresult cuLaunchGrid(CUfunction function, int width, int height) {
    return launch(function, width, height, CU_STREAM_LEGACY);
}

SIMGPU_API CUresult cuLaunchGridAsync(CUfunction function, int width, int height, CUstream stream) {
    return launch(function, width, height, stream);
}

SIMGPU_API CUresult cuLaunchCooperativeKernelMultiDevice(CUDA_LAUNCH_PARAMS* launches,
                                                         unsigned num_devices, unsigned flags) {
    if (CUresult error = require_init()) return error;
    constexpr unsigned kKnown = CUDA_COOPERATIVE_LAUNCH_MULTI_DEVICE_NO_PRE_LAUNCH_SYNC |
                                CUDA_COOPERATIVE_LAUNCH_MULTI_DEVICE_NO_POST_LAUNCH_SYNC;
    if (launches == nullptr || num_devices != 1 || (flags & ~kKnown) != 0)
        return CUDA_ERROR_INVALID_VALUE;
    const CUDA_LAUNCH_PARAMS& its = launches[0];
    const bool named = its.hStream != nullptr && its.hStream != CU_STREAM_LEGACY &&
                       its.hStream != CU_STREAM_PER_THREAD;
    if (!named) return CUDA_ERROR_INVALID_VALUE;
    return cuLaunchCooperativeKernel(its.function, its.gridDimX, its.gridDimY, its.gridDimZ,
                                     its.blockDimX, its.blockDimY, its.blockDimZ,
                                     its.sharedMemBytes, its.hStream, its.kernelParams);
}
