// SPDX-License-Identifier: Apache-2.0
//
// The integrated part (SIMGPU_DEVICE=integrated), on a driver of CUDA 12.4 (SIMGPU_DRIVER) that
// ignores the priority of a launch: its own program, because the choice is one for the process.
#include <cstdlib>

#include "tests/unit/test_simgpu_support.h"

namespace {

[[maybe_unused]] const int g_chosen = setenv("SIMGPU_DEVICE", "integrated", 1) +
                                      setenv("SIMGPU_DRIVER", "12.4", 1) +
                                      setenv("SIMGPU_PRIORITY_ATTRIBUTE", "ignored", 1);

int attribute(CUdevice_attribute which) {
    int value = -1;
    REQUIRE(cuDeviceGetAttribute(&value, which, 0) == CUDA_SUCCESS);
    return value;
}

CUresult launch_with(const SimGpu& gpu, CUlaunchAttribute attribute) {
    unsigned ns = 1000;
    void* params[] = {&ns};
    CUlaunchConfig config{1, 1, 1, 32, 1, 1, 0, nullptr, &attribute, 1};
    return cuLaunchKernelEx(&config, gpu.function("unit"), params, nullptr);
}

}  // namespace

TEST_CASE("Integrated part says that it shares memory when it is asked", "[unit][simgpu]") {
    const SimGpu gpu;
    CHECK(attribute(CU_DEVICE_ATTRIBUTE_INTEGRATED) == 1);
    CHECK(attribute(CU_DEVICE_ATTRIBUTE_CAN_MAP_HOST_MEMORY) == 1);
    CHECK(attribute(CU_DEVICE_ATTRIBUTE_UNIFIED_ADDRESSING) == 1);
    CHECK(attribute(CU_DEVICE_ATTRIBUTE_CONCURRENT_MANAGED_ACCESS) == 0);
    CHECK(attribute(CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT) == 8);
    std::size_t before = 0;
    std::size_t after = 0;
    void* host = nullptr;
    REQUIRE(cuMemGetInfo(&before, nullptr) == CUDA_SUCCESS);
    REQUIRE(cuMemHostAlloc(&host, 1 << 20, 0) == CUDA_SUCCESS);
    REQUIRE(cuMemGetInfo(&after, nullptr) == CUDA_SUCCESS);
    CHECK(before - after == 1 << 20);
    CUdeviceptr pointer = 0;
    REQUIRE(cuMemHostGetDevicePointer(&pointer, host, 0) == CUDA_SUCCESS);
    CHECK(pointer == reinterpret_cast<CUdeviceptr>(host));
}

TEST_CASE("Integrated part refuses a launch when it is programmatic", "[unit][simgpu]") {
    const SimGpu gpu;
    CUlaunchAttribute serialised{};
    serialised.id = CU_LAUNCH_ATTRIBUTE_PROGRAMMATIC_STREAM_SERIALIZATION;
    CHECK(launch_with(gpu, serialised) == CUDA_SUCCESS);  // not asked for
    serialised.value.programmaticStreamSerializationAllowed = 1;
    CHECK(launch_with(gpu, serialised) == CUDA_ERROR_NOT_SUPPORTED);
    REQUIRE(cuCtxSynchronize() == CUDA_SUCCESS);
    CHECK(kernel_log().size() == 1);
}

TEST_CASE("Launch keeps the stream's priority when the driver ignores its own", "[unit][simgpu]") {
    const SimGpu gpu;
    CUlaunchAttribute urgent{};
    urgent.id = CU_LAUNCH_ATTRIBUTE_PRIORITY;
    urgent.value.priority = -5;
    CHECK(launch_with(gpu, urgent) == CUDA_SUCCESS);
    REQUIRE(cuCtxSynchronize() == CUDA_SUCCESS);
    REQUIRE(kernel_log().size() == 1);
    CHECK(kernel_log()[0].priority == 0);
}

TEST_CASE("Driver answers like another when the environment says so", "[unit][simgpu]") {
    int version = 0;
    CHECK(cuDriverGetVersion(&version) == CUDA_SUCCESS);
    CHECK(version == 12040);
    void* newest = nullptr;
    void* older = nullptr;
    CHECK(cuGetProcAddress("cuCtxSynchronize", &newest, 12040, 0, nullptr) == CUDA_SUCCESS);
    CHECK(cuGetProcAddress("cuCtxSynchronize", &older, 2000, 0, nullptr) == CUDA_SUCCESS);
    CHECK(newest == older);
    CHECK(cuGetProcAddress("cuCtxSynchronize", &newest, 13000, 0, nullptr) ==
          CUDA_ERROR_INVALID_VALUE);
}
