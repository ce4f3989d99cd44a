// SPDX-License-Identifier: Apache-2.0
//
// What the driver refuses, and with which result. Also between valid calls: nothing sticks.
#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

CUfunction no_function() {
    static int not_a_function = 0;
    return reinterpret_cast<CUfunction>(&not_a_function);
}

CUresult launch(CUfunction f, unsigned gx, unsigned gy, unsigned gz, unsigned bx, unsigned by,
                unsigned bz, unsigned shared = 0, CUstream stream = nullptr) {
    return cuLaunchKernel(f, gx, gy, gz, bx, by, bz, shared, stream, nullptr, nullptr);
}

void refused_launches(const Gpu& gpu) {
    if (simulated()) {  // a real driver reads through the handle, and does not count parameters
        SHOW(launch(no_function(), 1, 1, 1, 1, 1, 1));
        SHOW(cuLaunchKernel(gpu.store, 1, 1, 1, 1, 1, 1, 0, nullptr, nullptr, nullptr));
    }
    SHOW(launch(nullptr, 1, 1, 1, 1, 1, 1));
    SHOW(launch(gpu.tiny, 0, 1, 1, 1, 1, 1));
    SHOW(launch(gpu.tiny, 1, 1, 0, 1, 1, 1));
    SHOW(launch(gpu.tiny, 1, 1, 1, 0, 1, 1));
    SHOW(launch(gpu.tiny, 1, 1, 1, 1025, 1, 1));
    SHOW(launch(gpu.tiny, 1, 1, 1, 65536, 65536, 1));
    SHOW(launch(gpu.tiny, 1, 65536, 1, 1, 1, 1));
    SHOW(launch(gpu.tiny, 1, 1, 1, 1, 1, 1, 1u << 20));
    void* parameters[] = {nullptr};
    void* extra[] = {CU_LAUNCH_PARAM_END};
    SHOW(cuLaunchKernel(gpu.tiny, 1, 1, 1, 1, 1, 1, 0, nullptr, parameters, extra));
    SHOW(cuLaunchCooperativeKernel(gpu.tiny, 100000, 1, 1, 1024, 1, 1, 0, nullptr, nullptr));
    SHOW(launch(gpu.tiny, 1, 1, 1, 1, 1, 1));
}

// Using a handle that was destroyed is undefined with a real driver.
void refused_streams(const Gpu& gpu) {
    CUstream destroyed = nullptr;
    MUST(cuStreamCreate(&destroyed, CU_STREAM_NON_BLOCKING));
    SHOW(launch_tiny(gpu.tiny, destroyed));
    SHOW(cuStreamDestroy(destroyed));
    SHOW(launch_tiny(gpu.tiny, destroyed));
    SHOW(cuStreamSynchronize(destroyed));
    SHOW(cuStreamQuery(destroyed));
    SHOW(cuStreamDestroy(destroyed));
    SHOW(cuCtxSynchronize());
    SHOW(launch_tiny(gpu.tiny, nullptr));
}

void refused_arguments() {
    SHOW(cuLaunchKernelEx(nullptr, nullptr, nullptr, nullptr));
    SHOW(cuStreamCreate(nullptr, 0));
    SHOW(cuEventCreate(nullptr, 0));
    SHOW(cuEventSynchronize(nullptr));
    SHOW(cuEventRecord(nullptr, nullptr));
    SHOW(cuMemAlloc(nullptr, 8));
    SHOW(cuMemcpyDtoH(nullptr, 0, 8));
    SHOW(cuMemcpyDtoH(nullptr, 0, 0));
    SHOW(cuModuleGetFunction(nullptr, nullptr, nullptr));
    SHOW(cuModuleLoadData(nullptr, nullptr));
    SHOW(cuLibraryUnload(nullptr));
    SHOW(cuStreamGetPriority(nullptr, nullptr));
    SHOW(cuCtxGetCurrent(nullptr));
    SHOW(cuGetProcAddress(nullptr, nullptr, 13000, 0, nullptr));
    SHOW(cuGetErrorName(CUDA_SUCCESS, nullptr));
    SHOW(cuStreamBeginCapture(nullptr, CU_STREAM_CAPTURE_MODE_GLOBAL));
    SHOW(cuStreamEndCapture(nullptr, nullptr));
}

int errors(const Arguments&) {
    const Gpu gpu;
    refused_launches(gpu);
    if (simulated()) {
        refused_streams(gpu);
        refused_arguments();
    }
    SHOW(launch_tiny(gpu.tiny, nullptr));
    SHOW(cuCtxSynchronize());
    return 0;
}

// Before cuInit, and with no context.
int too_early(const Arguments&) {
    SHOW(launch_tiny(no_function(), nullptr));
    SHOW(cuStreamSynchronize(nullptr));
    SHOW(cuCtxSynchronize());
    SHOW(cuModuleUnload(nullptr));
    SHOW(cuInit(1));
    SHOW(cuInit(0));
    SHOW(launch_tiny(no_function(), nullptr));
    SHOW(cuStreamSynchronize(nullptr));
    SHOW(cuCtxSynchronize());
    CUstream stream = nullptr;
    SHOW(cuStreamCreate(&stream, 0));
    const Gpu gpu;
    SHOW(launch_tiny(gpu.tiny, nullptr));
    SHOW(cuCtxSynchronize());
    return 0;
}

// Launches before a context: a real driver reads through the made-up handle.
const Scenario s1("errors", errors), s2("too_early", too_early, Runs::kSimulated);

}  // namespace
}  // namespace twin
