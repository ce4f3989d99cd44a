// SPDX-License-Identifier: Apache-2.0
//
// A machine with two simulated devices (SIMGPU_DEVICES): its own program, because the choice is one
// for the process.
#include <cstdlib>
#include <cstring>

#include "tests/unit/test_simgpu_support.h"

namespace {

[[maybe_unused]] const int g_chosen = setenv("SIMGPU_DEVICES", "2", 1);

/// The second device's primary context, current.
struct Second {
    Second() {
        REQUIRE(cuDevicePrimaryCtxRetain(&context, 1) == CUDA_SUCCESS);
        REQUIRE(cuCtxPushCurrent(context) == CUDA_SUCCESS);
    }
    ~Second() {
        cuCtxPopCurrent(nullptr);
        cuDevicePrimaryCtxRelease(1);
    }
    Second(const Second&) = delete;
    Second& operator=(const Second&) = delete;

    CUcontext context = nullptr;
};

std::size_t free_bytes() {
    std::size_t bytes = 0;
    REQUIRE(cuMemGetInfo(&bytes, nullptr) == CUDA_SUCCESS);
    return bytes;
}

CUmemoryPool pool_of(CUdevice device) {
    CUmemoryPool pool = nullptr;
    REQUIRE(cuDeviceGetMemPool(&pool, device) == CUDA_SUCCESS);
    return pool;
}

}  // namespace

TEST_CASE("Devices are alike but not the same when there are two", "[unit][simgpu]") {
    const SimGpu gpu;
    int count = 0;
    CUdevice device = -1;
    REQUIRE(cuDeviceGetCount(&count) == CUDA_SUCCESS);
    CHECK(count == 2);
    REQUIRE(cuDeviceGet(&device, 1) == CUDA_SUCCESS);
    CHECK(device == 1);
    CHECK(cuDeviceGet(&device, 2) == CUDA_ERROR_INVALID_DEVICE);
    CHECK(cuDeviceGet(&device, -1) == CUDA_ERROR_INVALID_DEVICE);
    char bus[2][32] = {};
    CUuuid uuid[2] = {};
    for (int i = 0; i < 2; ++i) {
        REQUIRE(cuDeviceGetPCIBusId(bus[i], sizeof bus[i], i) == CUDA_SUCCESS);
        REQUIRE(cuDeviceGetUuid(&uuid[i], i) == CUDA_SUCCESS);
        REQUIRE(cuDeviceGetByPCIBusId(&device, bus[i]) == CUDA_SUCCESS);
        CHECK(device == i);
    }
    CHECK(std::string(bus[0]) == "0000:01:00.0");
    CHECK(std::string(bus[1]) == "0000:02:00.0");
    CHECK(std::memcmp(&uuid[0], &uuid[1], sizeof uuid[0]) != 0);
    CHECK(cuDeviceGetByPCIBusId(&device, "0000:03:00.0") == CUDA_ERROR_INVALID_DEVICE);
}

TEST_CASE("Memory is the device's own when its context is current", "[unit][simgpu]") {
    const SimGpu gpu;
    const std::size_t before = free_bytes();
    const Second second;
    const std::size_t before_second = free_bytes();
    CUdeviceptr memory = 0;
    REQUIRE(cuMemAlloc(&memory, 1 << 20) == CUDA_SUCCESS);
    CHECK(free_bytes() == before_second - (1 << 20));
    int ordinal = -1;
    REQUIRE(cuPointerGetAttribute(&ordinal, CU_POINTER_ATTRIBUTE_DEVICE_ORDINAL, memory) ==
            CUDA_SUCCESS);
    CHECK(ordinal == 1);
    CHECK(pool_of(0) != pool_of(1));
    CHECK(cuDeviceSetMemPool(0, pool_of(1)) == CUDA_ERROR_INVALID_VALUE);
    CUdeviceptr pooled = 0;
    REQUIRE(cuMemAllocAsync(&pooled, 64, nullptr) == CUDA_SUCCESS);
    cuuint64_t used = 0;
    REQUIRE(cuMemPoolGetAttribute(pool_of(1), CU_MEMPOOL_ATTR_USED_MEM_CURRENT, &used) ==
            CUDA_SUCCESS);
    CHECK(used == 512);
    REQUIRE(cuMemPoolGetAttribute(pool_of(0), CU_MEMPOOL_ATTR_USED_MEM_CURRENT, &used) ==
            CUDA_SUCCESS);
    CHECK(used == 0);
    REQUIRE(cuCtxPushCurrent(gpu.context) == CUDA_SUCCESS);
    CHECK(free_bytes() == before);
    REQUIRE(cuCtxPopCurrent(nullptr) == CUDA_SUCCESS);
}

TEST_CASE("Kernels run on their context's device when there are two", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream here = gpu.stream();
    const Second second;
    CUmodule module = nullptr;
    CUfunction function = nullptr;
    REQUIRE(cuModuleLoadData(&module, R"({"default": {"block_ns": 50000000}})") == CUDA_SUCCESS);
    REQUIRE(cuModuleGetFunction(&function, module, "there") == CUDA_SUCCESS);
    const CUstream there = gpu.stream();
    CUdevice device = -1;
    REQUIRE(cuStreamGetDevice(there, &device) == CUDA_SUCCESS);
    CHECK(device == 1);
    // Each fills its device.
    REQUIRE(gpu.launch(here, 50000000, 46) == CUDA_SUCCESS);
    REQUIRE(cuLaunchKernel(function, 46 * 16, 1, 1, 32, 1, 1, 0, there, nullptr, nullptr) ==
            CUDA_SUCCESS);
    CHECK(cuLaunchKernel(function, 1, 1, 1, 32, 1, 1, 0, here, nullptr, nullptr) ==
          CUDA_ERROR_INVALID_HANDLE);
    REQUIRE(cuStreamSynchronize(here) == CUDA_SUCCESS);
    REQUIRE(cuStreamSynchronize(there) == CUDA_SUCCESS);
    const auto log = kernel_log();
    REQUIRE(log.size() == 2);
    CHECK(log[0].device + log[1].device == 1);
    CHECK(log[0].start_ns < log[1].end_ns);
    CHECK(log[1].start_ns < log[0].end_ns);
}
