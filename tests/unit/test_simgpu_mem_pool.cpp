// SPDX-License-Identifier: Apache-2.0
//
// Stream-ordered allocation and memory pools of the simulated driver.
#include "tests/unit/test_simgpu_support.h"

namespace {

CUmemoryPool default_pool() {
    CUmemoryPool pool = nullptr;
    REQUIRE(cuDeviceGetDefaultMemPool(&pool, 0) == CUDA_SUCCESS);
    return pool;
}

cuuint64_t attribute(CUmemoryPool pool, CUmemPool_attribute which) {
    cuuint64_t value = 0;
    REQUIRE(cuMemPoolGetAttribute(pool, which, &value) == CUDA_SUCCESS);
    return value;
}

CUdeviceptr allocate(std::size_t bytes, CUstream stream) {
    CUdeviceptr pointer = 0;
    REQUIRE(cuMemAllocAsync(&pointer, bytes, stream) == CUDA_SUCCESS);
    return pointer;
}

std::size_t free_bytes() {
    std::size_t bytes = 0;
    REQUIRE(cuMemGetInfo(&bytes, nullptr) == CUDA_SUCCESS);
    return bytes;
}

constexpr std::size_t kBytes = 1 << 20;

}  // namespace

TEST_CASE("Memory freed on a stream is given out again there when the free is still to come",
          "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    const CUstream other = gpu.stream();
    Gate gate;
    gate.hold(stream);
    const CUdeviceptr first = allocate(kBytes, stream);
    REQUIRE(cuMemsetD8Async(first, 1, kBytes, stream) == CUDA_SUCCESS);
    REQUIRE(cuMemFreeAsync(first, stream) == CUDA_SUCCESS);
    CHECK(cuMemFreeAsync(first, stream) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemsetD8Async(first, 1, kBytes, stream) == CUDA_ERROR_INVALID_VALUE);
    // Another stream may not have it: it would run ahead of the first one's use.
    CHECK(allocate(kBytes, other) != first);
    const CUdeviceptr again = allocate(kBytes, stream);
    CHECK(again == first);
    REQUIRE(cuMemsetD8Async(again, 2, kBytes, stream) == CUDA_SUCCESS);
    gate.open();
    REQUIRE(cuStreamSynchronize(stream) == CUDA_SUCCESS);
    unsigned char last = 0;
    REQUIRE(cuMemcpyDtoH(&last, again + kBytes - 1, 1) == CUDA_SUCCESS);
    CHECK(last == 2);
}

TEST_CASE("Memory freed on a stream is given out on another when the free is done",
          "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    const CUstream other = gpu.stream();
    cuuint64_t keep_all = UINT64_MAX;
    REQUIRE(cuMemPoolSetAttribute(default_pool(), CU_MEMPOOL_ATTR_RELEASE_THRESHOLD, &keep_all) ==
            CUDA_SUCCESS);
    const CUdeviceptr first = allocate(kBytes, stream);
    REQUIRE(cuMemFreeAsync(first, stream) == CUDA_SUCCESS);
    REQUIRE(cuStreamSynchronize(stream) == CUDA_SUCCESS);
    int opportunistic = 0;
    REQUIRE(cuMemPoolSetAttribute(default_pool(), CU_MEMPOOL_ATTR_REUSE_ALLOW_OPPORTUNISTIC,
                                  &opportunistic) == CUDA_SUCCESS);
    CHECK(allocate(kBytes, other) != first);
    opportunistic = 1;
    REQUIRE(cuMemPoolSetAttribute(default_pool(), CU_MEMPOOL_ATTR_REUSE_ALLOW_OPPORTUNISTIC,
                                  &opportunistic) == CUDA_SUCCESS);
    CHECK(allocate(kBytes, other) == first);
    cuuint64_t keep_none = 0;
    REQUIRE(cuMemPoolSetAttribute(default_pool(), CU_MEMPOOL_ATTR_RELEASE_THRESHOLD, &keep_none) ==
            CUDA_SUCCESS);
}

TEST_CASE("Pool keeps what its threshold allows when a stream is synchronised", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    CUmemPoolProps props{};
    props.allocType = CU_MEM_ALLOCATION_TYPE_PINNED;
    props.location = {CU_MEM_LOCATION_TYPE_DEVICE, 0};
    CUmemoryPool pool = nullptr;
    REQUIRE(cuMemPoolCreate(&pool, &props) == CUDA_SUCCESS);
    cuuint64_t threshold = 3 * kBytes;
    REQUIRE(cuMemPoolSetAttribute(pool, CU_MEMPOOL_ATTR_RELEASE_THRESHOLD, &threshold) ==
            CUDA_SUCCESS);
    CHECK(attribute(pool, CU_MEMPOOL_ATTR_RELEASE_THRESHOLD) == threshold);

    const std::size_t before = free_bytes();
    CUdeviceptr pointers[4]{};
    for (CUdeviceptr& pointer : pointers) {
        REQUIRE(cuMemAllocFromPoolAsync(&pointer, kBytes, pool, stream) == CUDA_SUCCESS);
    }
    CHECK(attribute(pool, CU_MEMPOOL_ATTR_USED_MEM_CURRENT) == 4 * kBytes);
    CHECK(attribute(pool, CU_MEMPOOL_ATTR_RESERVED_MEM_CURRENT) == 4 * kBytes);
    Gate gate;
    gate.hold(stream);
    for (const CUdeviceptr pointer : pointers) {
        REQUIRE(cuMemFreeAsync(pointer, stream) == CUDA_SUCCESS);
    }
    // The stream has not got there yet.
    CHECK(attribute(pool, CU_MEMPOOL_ATTR_USED_MEM_CURRENT) == 4 * kBytes);
    gate.open();
    REQUIRE(cuStreamSynchronize(stream) == CUDA_SUCCESS);
    CHECK(attribute(pool, CU_MEMPOOL_ATTR_USED_MEM_CURRENT) == 0);
    CHECK(attribute(pool, CU_MEMPOOL_ATTR_RESERVED_MEM_CURRENT) == threshold);
    CHECK(before - free_bytes() == threshold);
    REQUIRE(cuMemPoolTrimTo(pool, kBytes) == CUDA_SUCCESS);
    CHECK(before - free_bytes() == kBytes);
    CHECK(attribute(pool, CU_MEMPOOL_ATTR_USED_MEM_HIGH) == 4 * kBytes);
    cuuint64_t mark = 0;
    REQUIRE(cuMemPoolSetAttribute(pool, CU_MEMPOOL_ATTR_USED_MEM_HIGH, &mark) == CUDA_SUCCESS);
    CHECK(attribute(pool, CU_MEMPOOL_ATTR_USED_MEM_HIGH) == 0);
    mark = 1;
    CHECK(cuMemPoolSetAttribute(pool, CU_MEMPOOL_ATTR_USED_MEM_HIGH, &mark) ==
          CUDA_ERROR_INVALID_VALUE);

    REQUIRE(cuMemPoolDestroy(pool) == CUDA_SUCCESS);
    CHECK(free_bytes() == before);
    CHECK(cuMemPoolTrimTo(pool, 0) == CUDA_ERROR_INVALID_VALUE);
}

TEST_CASE("Pool of the device is the default one when none is set", "[unit][simgpu]") {
    const SimGpu gpu;
    CUmemPoolProps props{};
    props.allocType = CU_MEM_ALLOCATION_TYPE_PINNED;
    props.location = {CU_MEM_LOCATION_TYPE_DEVICE, 0};
    props.maxSize = kBytes;
    CUmemoryPool own = nullptr;
    CUmemoryPool current = nullptr;
    REQUIRE(cuMemPoolCreate(&own, &props) == CUDA_SUCCESS);
    CHECK(cuDeviceGetMemPool(&current, 0) == CUDA_SUCCESS);
    CHECK(current == default_pool());
    REQUIRE(cuDeviceSetMemPool(0, own) == CUDA_SUCCESS);
    const CUdeviceptr pointer = allocate(kBytes, nullptr);
    CHECK(attribute(own, CU_MEMPOOL_ATTR_USED_MEM_CURRENT) == kBytes);
    CUdeviceptr more = 0;
    CHECK(cuMemAllocAsync(&more, kBytes, nullptr) == CUDA_ERROR_OUT_OF_MEMORY);  // maxSize
    REQUIRE(cuMemFree(pointer) == CUDA_SUCCESS);
    CHECK(attribute(own, CU_MEMPOOL_ATTR_USED_MEM_CURRENT) == 0);
    REQUIRE(cuMemPoolDestroy(own) == CUDA_SUCCESS);
    CHECK(cuDeviceGetMemPool(&current, 0) == CUDA_SUCCESS);
    CHECK(current == default_pool());
    CHECK(cuMemPoolDestroy(default_pool()) == CUDA_ERROR_INVALID_VALUE);
    props.location.id = 1;
    CHECK(cuMemPoolCreate(&own, &props) == CUDA_ERROR_INVALID_VALUE);
}
