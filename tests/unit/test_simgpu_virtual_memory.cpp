// SPDX-License-Identifier: Apache-2.0
//
// Memory that programs map to addresses themselves, arrays with levels, and which calls about
// memory wait for the work of the simulated driver's contexts.
#include <atomic>
#include <cstring>
#include <functional>
#include <thread>

#include "tests/unit/test_simgpu_support.h"

namespace {

constexpr std::size_t kBytes = 2 << 20;

CUmemAllocationProp on_device(int device = 0) {
    CUmemAllocationProp properties{};
    properties.type = CU_MEM_ALLOCATION_TYPE_PINNED;
    properties.location = {CU_MEM_LOCATION_TYPE_DEVICE, {device}};
    return properties;
}

CUmemGenericAllocationHandle make_memory(std::size_t bytes = kBytes) {
    const CUmemAllocationProp properties = on_device();
    CUmemGenericAllocationHandle memory = 0;
    REQUIRE(cuMemCreate(&memory, bytes, &properties, 0) == CUDA_SUCCESS);
    return memory;
}

CUdeviceptr reserve(std::size_t bytes, std::size_t alignment = 0) {
    CUdeviceptr address = 0;
    REQUIRE(cuMemAddressReserve(&address, bytes, alignment, 0, 0) == CUDA_SUCCESS);
    return address;
}

CUresult allow(CUdeviceptr address, std::size_t bytes) {
    const CUmemAccessDesc access{{CU_MEM_LOCATION_TYPE_DEVICE, {0}},
                                 CU_MEM_ACCESS_FLAGS_PROT_READWRITE};
    return cuMemSetAccess(address, bytes, &access, 1);
}

std::size_t free_bytes() {
    std::size_t bytes = 0;
    REQUIRE(cuMemGetInfo(&bytes, nullptr) == CUDA_SUCCESS);
    return bytes;
}

CUmipmappedArray make_mipmapped(unsigned num_levels) {
    CUDA_ARRAY3D_DESCRIPTOR shape{};
    shape.Width = 16, shape.Height = 8, shape.NumChannels = 1;
    shape.Format = CU_AD_FORMAT_UNSIGNED_INT8;
    CUmipmappedArray array = nullptr;
    REQUIRE(cuMipmappedArrayCreate(&array, &shape, num_levels) == CUDA_SUCCESS);
    return array;
}

}  // namespace

TEST_CASE("Mapped memory holds the same wherever it is mapped", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUdeviceptr a = reserve(2 * kBytes, 4 * kBytes), b = reserve(kBytes);
    CHECK(a % (4 * kBytes) == 0);
    const auto memory = make_memory();
    REQUIRE(cuMemMap(a + kBytes, kBytes, 0, memory, 0) == CUDA_SUCCESS);
    REQUIRE(cuMemMap(b, kBytes, 0, memory, 0) == CUDA_SUCCESS);
    REQUIRE(allow(a + kBytes, kBytes) == CUDA_SUCCESS);
    REQUIRE(allow(b, kBytes) == CUDA_SUCCESS);
    CHECK(cuMemsetD32(a + kBytes, 17, kBytes / 4) == CUDA_SUCCESS);
    unsigned found = 0;
    CHECK(cuMemcpyDtoH(&found, b + kBytes - 4, 4) == CUDA_SUCCESS);
    CHECK(found == 17);
    // Without its handle, and in fewer places, it is still there; mapped anew it is another one's.
    CHECK(cuMemRelease(memory) == CUDA_SUCCESS);
    CHECK(cuMemUnmap(a + kBytes, kBytes) == CUDA_SUCCESS);
    CHECK(cuMemcpyDtoH(&found, b, 4) == CUDA_SUCCESS);
    CHECK(found == 17);
    CHECK(cuMemcpyDtoH(&found, a + kBytes, 4) == CUDA_ERROR_INVALID_VALUE);
    const auto other = make_memory();
    REQUIRE(cuMemMap(a + kBytes, kBytes, 0, other, 0) == CUDA_SUCCESS);
    REQUIRE(allow(a + kBytes, kBytes) == CUDA_SUCCESS);
    CHECK(cuMemcpyDtoH(&found, a + kBytes, 4) == CUDA_SUCCESS);
    CHECK(found == 0);
    CHECK(cuMemUnmap(a + kBytes, kBytes) == CUDA_SUCCESS);
    CHECK(cuMemUnmap(b, kBytes) == CUDA_SUCCESS);
    CHECK(cuMemRelease(other) == CUDA_SUCCESS);
    CHECK(cuMemAddressFree(a, 2 * kBytes) == CUDA_SUCCESS);
    CHECK(cuMemAddressFree(b, kBytes) == CUDA_SUCCESS);
}

TEST_CASE("Memory of its own takes the device's until it is released and unmapped",
          "[unit][simgpu]") {
    const SimGpu gpu;
    const std::size_t at_first = free_bytes();
    const CUdeviceptr address = reserve(kBytes);
    CHECK(free_bytes() == at_first);
    const auto memory = make_memory();
    CHECK(free_bytes() == at_first - kBytes);
    REQUIRE(cuMemMap(address, kBytes, 0, memory, 0) == CUDA_SUCCESS);
    CHECK(free_bytes() == at_first - kBytes);
    CHECK(cuMemRelease(memory) == CUDA_SUCCESS);
    CHECK(free_bytes() == at_first - kBytes);
    CHECK(cuMemUnmap(address, kBytes) == CUDA_SUCCESS);
    CHECK(free_bytes() == at_first);
    CHECK(cuMemAddressFree(address, kBytes) == CUDA_SUCCESS);
    const CUmemAllocationProp properties = on_device();
    CUmemGenericAllocationHandle too_large = 0;
    CHECK(cuMemCreate(&too_large, at_first / kBytes * kBytes + kBytes, &properties, 0) ==
          CUDA_ERROR_OUT_OF_MEMORY);
    CHECK(free_bytes() == at_first);
}

TEST_CASE("Mapping is refused when memory or addresses do not fit", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUmemAllocationProp properties = on_device(), nowhere = on_device(7);
    std::size_t granularity = 0;
    CHECK(cuMemGetAllocationGranularity(&granularity, &properties,
                                        CU_MEM_ALLOC_GRANULARITY_MINIMUM) == CUDA_SUCCESS);
    CHECK(granularity == kBytes);
    CUmemGenericAllocationHandle handle = 0;
    CUdeviceptr address = 0;
    CHECK(cuMemCreate(&handle, kBytes + 1, &properties, 0) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemCreate(&handle, kBytes, &nowhere, 0) == CUDA_ERROR_INVALID_DEVICE);
    CHECK(cuMemAddressReserve(&address, 0, 0, 0, 0) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemAddressReserve(&address, kBytes, 3, 0, 0) ==
          CUDA_SUCCESS);  // less than it is anyway
    CHECK(cuMemAddressFree(address, kBytes) == CUDA_SUCCESS);
    address = reserve(2 * kBytes);
    const auto memory = make_memory();
    CHECK(cuMemMap(address + 2 * kBytes, kBytes, 0, memory, 0) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemMap(address, 2 * kBytes, 0, memory, 0) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemMap(address, kBytes, 0, memory + 1, 0) == CUDA_ERROR_INVALID_VALUE);
    CHECK(allow(address, kBytes) == CUDA_ERROR_INVALID_VALUE);
    REQUIRE(cuMemMap(address, kBytes, 0, memory, 0) == CUDA_SUCCESS);
    CHECK(cuMemMap(address, kBytes, 0, memory, 0) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemUnmap(address, 2 * kBytes) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemUnmap(address + kBytes, kBytes) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemUnmap(0, kBytes) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemFree(address) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemAddressFree(address, 2 * kBytes) == CUDA_ERROR_INVALID_VALUE);
    REQUIRE(cuMemMap(address + kBytes, kBytes, 0, memory, 0) == CUDA_SUCCESS);
    CHECK(cuMemUnmap(address, 2 * kBytes) == CUDA_SUCCESS);
    CHECK(cuMemRelease(memory) == CUDA_SUCCESS);
    CHECK(cuMemRelease(memory) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemAddressFree(address, 2 * kBytes) == CUDA_SUCCESS);
}

TEST_CASE("Levels of an array hold their own data when they are copied", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUmipmappedArray array = make_mipmapped(100);  // five are possible: 16, 8, 4, 2, 1
    CUarray level = nullptr;
    CHECK(cuMipmappedArrayGetLevel(&level, array, 5) == CUDA_ERROR_INVALID_VALUE);
    for (unsigned i = 0; i < 5; ++i) {
        REQUIRE(cuMipmappedArrayGetLevel(&level, array, i) == CUDA_SUCCESS);
        const char value = static_cast<char>('a' + i);
        CHECK(cuMemcpyHtoA(level, 0, &value, 1) == CUDA_SUCCESS);
        CHECK(cuArrayDestroy(level) == CUDA_ERROR_INVALID_HANDLE);
    }
    for (unsigned i = 0; i < 5; ++i) {
        REQUIRE(cuMipmappedArrayGetLevel(&level, array, i) == CUDA_SUCCESS);
        char found = 0;
        CHECK(cuMemcpyAtoH(&found, level, 0, 1) == CUDA_SUCCESS);
        CHECK(found == static_cast<char>('a' + i));
    }
    CHECK(cuMipmappedArrayDestroy(array) == CUDA_SUCCESS);
    CHECK(cuMipmappedArrayDestroy(array) == CUDA_ERROR_INVALID_HANDLE);
    CHECK(cuMipmappedArrayGetLevel(&level, array, 0) == CUDA_ERROR_INVALID_HANDLE);
}

TEST_CASE("Limits are kept, and those of no use here refused", "[unit][simgpu]") {
    const SimGpu gpu;
    std::size_t bytes = 0;
    CHECK(cuCtxGetLimit(&bytes, CU_LIMIT_STACK_SIZE) == CUDA_SUCCESS);
    CHECK(bytes == 1024);
    CHECK(cuCtxSetLimit(CU_LIMIT_STACK_SIZE, 2048) == CUDA_SUCCESS);
    CHECK(cuCtxGetLimit(&bytes, CU_LIMIT_STACK_SIZE) == CUDA_SUCCESS);
    CHECK(bytes == 2048);
    CHECK(cuCtxSetLimit(CU_LIMIT_MAX, 1) == CUDA_ERROR_UNSUPPORTED_LIMIT);
}

TEST_CASE("Unmapping, and destroying an array, wait for work that is under way", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    const CUdeviceptr address = reserve(kBytes);
    const auto memory = make_memory();
    REQUIRE(cuMemMap(address, kBytes, 0, memory, 0) == CUDA_SUCCESS);
    const CUmipmappedArray array = make_mipmapped(2);
    const std::function<CUresult()> calls[] = {
        [&] { return cuMemUnmap(address, kBytes); }, [&] { return cuMipmappedArrayDestroy(array); },
        [&] { return cuCtxSetLimit(CU_LIMIT_STACK_SIZE, 1024); }};
    for (const auto& call : calls) {
        Gate gate;
        gate.hold(stream);
        std::atomic<bool> opened{false};
        std::thread opener([&] {
            std::this_thread::sleep_for(std::chrono::milliseconds(20));
            opened = true;
            gate.open();
        });
        CHECK(call() == CUDA_SUCCESS);
        CHECK(opened);
        opener.join();
    }
    CHECK(cuMemRelease(memory) == CUDA_SUCCESS);
    CHECK(cuMemAddressFree(address, kBytes) == CUDA_SUCCESS);
}
