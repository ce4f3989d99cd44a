// SPDX-License-Identifier: Apache-2.0
//
// Initialisation, device queries, contexts of the simulated driver.
#include <sys/wait.h>
#include <unistd.h>

#include <thread>

#include "tests/unit/test_simgpu_support.h"

// What cuCtxCreate means depends on the toolkit's version; this does not.
extern "C" CUresult cuCtxCreate_v2(CUcontext*, unsigned, CUdevice);

// cuCtxAttach and cuCtxDetach: old, and still there.
#pragma GCC diagnostic ignored "-Wdeprecated-declarations"

TEST_CASE("Driver refuses calls when a forked child makes them", "[unit][simgpu]") {
    const SimGpu gpu;
    const pid_t child = fork();
    if (child == 0) {
        int count = 0;
        _exit(cuDeviceGetCount(&count) == CUDA_ERROR_NOT_INITIALIZED &&
                      cuStreamSynchronize(nullptr) == CUDA_ERROR_NOT_INITIALIZED
                  ? 0
                  : 1);
    }
    int status = -1;
    REQUIRE(waitpid(child, &status, 0) == child);
    CHECK(WIFEXITED(status));
    CHECK(WEXITSTATUS(status) == 0);
}

TEST_CASE("Device describes itself when asked", "[unit][simgpu]") {
    const SimGpu gpu;
    int count = 0;
    CHECK(cuDeviceGetCount(&count) == CUDA_SUCCESS);
    CHECK(count == 1);
    CUdevice device = -1;
    CHECK(cuDeviceGet(&device, 1) == CUDA_ERROR_INVALID_DEVICE);
    CHECK(cuDeviceGet(&device, 0) == CUDA_SUCCESS);
    char name[64];
    CHECK(cuDeviceGetName(name, sizeof name, device) == CUDA_SUCCESS);
    CHECK(std::string(name) == "UrgenGo Simulated GPU");
    char cut[8];
    CHECK(cuDeviceGetName(cut, sizeof cut, device) == CUDA_SUCCESS);
    CHECK(std::string(cut) == "UrgenGo");
    int value = 0;
    CHECK(cuDeviceGetAttribute(&value, CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT, 0) ==
          CUDA_SUCCESS);
    CHECK(value == 46);
    CHECK(cuDeviceGetAttribute(&value, CU_DEVICE_ATTRIBUTE_MAX, 0) == CUDA_ERROR_INVALID_VALUE);
    int version = 0;
    CHECK(cuDriverGetVersion(&version) == CUDA_SUCCESS);
    CHECK(version == 13000);
}

TEST_CASE("Context stack pushes and pops when several contexts are used", "[unit][simgpu]") {
    const SimGpu gpu;
    CUcontext own = nullptr;
    REQUIRE(cuCtxCreate_v2(&own, CU_CTX_SCHED_YIELD, 0) == CUDA_SUCCESS);
    CUcontext current = nullptr;
    CHECK(cuCtxGetCurrent(&current) == CUDA_SUCCESS);
    CHECK(current == own);
    unsigned flags = 0;
    CHECK(cuCtxGetFlags(&flags) == CUDA_SUCCESS);
    CHECK(flags == (CU_CTX_SCHED_YIELD | CU_CTX_MAP_HOST));
    CHECK(cuCtxPopCurrent(&current) == CUDA_SUCCESS);
    CHECK(current == own);
    CHECK(cuCtxGetCurrent(&current) == CUDA_SUCCESS);
    CHECK(current == gpu.context);
    CHECK(cuCtxDestroy(own) == CUDA_SUCCESS);
    CHECK(cuCtxPushCurrent(own) == CUDA_ERROR_CONTEXT_IS_DESTROYED);
}

TEST_CASE("Context leaves the stack when it is destroyed while current", "[unit][simgpu]") {
    const SimGpu gpu;
    CUcontext own = nullptr;
    REQUIRE(cuCtxCreate_v2(&own, 0, 0) == CUDA_SUCCESS);
    REQUIRE(cuCtxDestroy(own) == CUDA_SUCCESS);
    CUcontext current = nullptr;
    CHECK(cuCtxGetCurrent(&current) == CUDA_SUCCESS);
    CHECK(current == gpu.context);
}

TEST_CASE("Context is destroyed when whoever attached to it last detaches", "[unit][simgpu]") {
    const SimGpu gpu;
    CUcontext own = nullptr, attached = nullptr, current = nullptr;
    REQUIRE(cuCtxCreate_v2(&own, 0, 0) == CUDA_SUCCESS);
    CHECK(cuCtxAttach(&attached, 1) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuCtxAttach(&attached, 0) == CUDA_SUCCESS);
    CHECK(attached == own);
    CHECK(cuCtxDetach(own) == CUDA_SUCCESS);
    CHECK(cuCtxGetCurrent(&current) == CUDA_SUCCESS);
    CHECK(current == own);
    CHECK(cuCtxPushCurrent_v2(gpu.context) == CUDA_SUCCESS);
    CHECK(cuCtxDetach(own) == CUDA_ERROR_INVALID_CONTEXT);  // not current
    CHECK(cuCtxDetach(gpu.context) == CUDA_SUCCESS);        // the primary one stays
    CHECK(cuCtxPopCurrent_v2(&current) == CUDA_SUCCESS);
    CHECK(cuCtxDetach(own) == CUDA_SUCCESS);
    CHECK(cuCtxGetCurrent(&current) == CUDA_SUCCESS);
    CHECK(current == gpu.context);
    CHECK(cuCtxSetCurrent(own) == CUDA_ERROR_CONTEXT_IS_DESTROYED);
}

TEST_CASE("Context is refused to every thread when it has been destroyed", "[unit][simgpu]") {
    const SimGpu gpu;
    CUcontext own = nullptr;
    REQUIRE(cuCtxCreate_v2(&own, 0, 0) == CUDA_SUCCESS);
    CUstream stream = nullptr;
    REQUIRE(cuStreamCreate(&stream, CU_STREAM_DEFAULT) == CUDA_SUCCESS);
    CUresult before = CUDA_ERROR_UNKNOWN;
    CUresult after = CUDA_ERROR_UNKNOWN;
    std::thread thread([&] {
        before = cuCtxSetCurrent(own);
        std::thread([own] { cuCtxDestroy(own); }).join();
        after = cuStreamSynchronize(nullptr);
    });
    thread.join();
    CHECK(before == CUDA_SUCCESS);
    CHECK(after == CUDA_ERROR_CONTEXT_IS_DESTROYED);
    CHECK(cuStreamQuery(stream) == CUDA_ERROR_INVALID_HANDLE);
    CUcontext popped = nullptr;
    cuCtxPopCurrent(&popped);
}

TEST_CASE("Calls that need a context fail when none is current", "[unit][simgpu]") {
    const SimGpu gpu;
    CUresult result = CUDA_SUCCESS;
    std::thread([&result] { result = cuStreamSynchronize(nullptr); }).join();
    CHECK(result == CUDA_ERROR_INVALID_CONTEXT);
}

TEST_CASE("Primary context is active while it is retained", "[unit][simgpu]") {
    REQUIRE(cuInit(0) == CUDA_SUCCESS);
    unsigned flags = 99;
    int active = -1;
    CUcontext first = nullptr;
    {
        const SimGpu gpu;
        first = gpu.context;
        CHECK(cuDevicePrimaryCtxGetState(0, &flags, &active) == CUDA_SUCCESS);
        CHECK(active == 1);
    }
    CHECK(cuDevicePrimaryCtxGetState(0, &flags, &active) == CUDA_SUCCESS);
    CHECK(active == 0);
    CHECK(cuDevicePrimaryCtxRelease(0) == CUDA_ERROR_INVALID_CONTEXT);
    const SimGpu again;
    CHECK(again.context == first);
}

TEST_CASE("Context says which stream priorities there are when asked", "[unit][simgpu]") {
    const SimGpu gpu;
    int least = 1;
    int greatest = 1;
    CHECK(cuCtxGetStreamPriorityRange(&least, &greatest) == CUDA_SUCCESS);
    CHECK(least == 0);
    CHECK(greatest == -5);
}

TEST_CASE("Error codes have their names when asked", "[unit][simgpu]") {
    const char* name = nullptr;
    CHECK(cuGetErrorName(CUDA_ERROR_NOT_READY, &name) == CUDA_SUCCESS);
    CHECK(std::string(name) == "CUDA_ERROR_NOT_READY");
    CHECK(cuGetErrorName(static_cast<CUresult>(12345), &name) == CUDA_ERROR_INVALID_VALUE);
    CHECK(name == nullptr);
}
