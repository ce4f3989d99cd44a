// SPDX-License-Identifier: Apache-2.0
//
// Memory and copies of the simulated driver.
#include <numeric>

#include "tests/unit/test_simgpu_support.h"

namespace {

CUdeviceptr allocate(std::size_t bytes) {
    CUdeviceptr pointer = 0;
    REQUIRE(cuMemAlloc(&pointer, bytes) == CUDA_SUCCESS);
    return pointer;
}

}  // namespace

TEST_CASE("Copies move the data when they are done", "[unit][simgpu]") {
    const SimGpu gpu;
    std::vector<int> in(1000);
    std::iota(in.begin(), in.end(), 1);
    std::vector<int> out(in.size());
    const std::size_t bytes = in.size() * sizeof(int);
    const CUdeviceptr a = allocate(bytes);
    const CUdeviceptr b = allocate(bytes);
    CHECK(cuMemcpyHtoD(a, in.data(), bytes) == CUDA_SUCCESS);
    CHECK(cuMemcpyDtoD(b, a, bytes) == CUDA_SUCCESS);
    CHECK(cuMemcpyDtoH(out.data(), b, bytes) == CUDA_SUCCESS);
    CHECK(out == in);
    CHECK(cuMemsetD32(a, 7, in.size()) == CUDA_SUCCESS);
    CHECK(cuMemsetD16(a + 4, 0x0102, 2) == CUDA_SUCCESS);
    CHECK(cuMemsetD8(a + 8, 0xff, 1) == CUDA_SUCCESS);
    CHECK(cuMemcpy(reinterpret_cast<CUdeviceptr>(out.data()), a, bytes) == CUDA_SUCCESS);
    CHECK(out[0] == 7);
    CHECK(out[1] == 0x01020102);
    CHECK(out[2] == 0xff);
    CHECK(out[999] == 7);
    CHECK(cuMemFree(a) == CUDA_SUCCESS);
    CHECK(cuMemFree(b) == CUDA_SUCCESS);
}

TEST_CASE("Asynchronous copy takes simulated time when memory is page-locked", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    constexpr std::size_t kBytes = 2400000;  // 100 us at 24 GB/s, and 1 us
    void* host = nullptr;
    REQUIRE(cuMemAllocHost(&host, kBytes) == CUDA_SUCCESS);
    const CUdeviceptr device = allocate(kBytes);
    CUevent start = nullptr;
    CUevent end = nullptr;
    cuEventCreate(&start, 0);
    cuEventCreate(&end, 0);
    Gate gate;
    gate.hold(stream);
    cuEventRecord(start, stream);
    CHECK(cuMemcpyHtoDAsync(device, host, kBytes, stream) == CUDA_SUCCESS);
    cuEventRecord(end, stream);
    CHECK(cuStreamQuery(stream) == CUDA_ERROR_NOT_READY);
    gate.open();
    REQUIRE(cuStreamSynchronize(stream) == CUDA_SUCCESS);
    float ms = 0;
    CHECK(cuEventElapsedTime(&ms, start, end) == CUDA_SUCCESS);
    CHECK(ms == Approx(0.101));
}

TEST_CASE("Asynchronous copy has read pageable memory when it returns", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    const CUdeviceptr device = allocate(4);
    int value = 42;
    gpu.launch(stream, 1000000);
    REQUIRE(cuMemcpyHtoDAsync(device, &value, 4, stream) == CUDA_SUCCESS);
    value = 0;
    int result = 0;
    REQUIRE(cuMemcpyDtoHAsync(&result, device, 4, stream) == CUDA_SUCCESS);
    CHECK(result == 42);  // to pageable memory: done when the call returns
}

TEST_CASE("Copy is refused when its range is not the device's", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUdeviceptr device = allocate(100);
    char host[200] = {};
    CHECK(cuMemcpyHtoD(device, host, 101) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemcpyHtoD(device + 50, host, 51) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemcpyDtoH(host, device, 101) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemcpyDtoH(host, reinterpret_cast<CUdeviceptr>(host), 1) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemsetD32(device + 2, 0, 1) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemcpyHtoD(device, host, 0) == CUDA_SUCCESS);
}

TEST_CASE("Memory is accounted for when it is allocated and freed", "[unit][simgpu]") {
    const SimGpu gpu;
    std::size_t before = 0;
    std::size_t during = 0;
    std::size_t after = 0;
    std::size_t total = 0;
    cuMemGetInfo(&before, &total);
    const CUdeviceptr pointer = allocate(1 << 20);
    cuMemGetInfo(&during, nullptr);
    CHECK(before - during == 1 << 20);
    CHECK(cuMemFree(pointer + 1) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemFree(pointer) == CUDA_SUCCESS);
    CHECK(cuMemFree(pointer) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemFree(0) == CUDA_SUCCESS);
    cuMemGetInfo(&after, nullptr);
    CHECK(after == before);
    CUdeviceptr huge = 0;
    CHECK(cuMemAlloc(&huge, total + 1) == CUDA_ERROR_OUT_OF_MEMORY);
    CHECK(cuMemAlloc(&huge, 0) == CUDA_ERROR_INVALID_VALUE);
    void* nothing = &huge;
    CHECK(cuMemHostAlloc(&nothing, 0, 0) == CUDA_SUCCESS);
    CHECK(nothing == nullptr);
    CHECK(cuMemFreeHost(nullptr) == CUDA_SUCCESS);
}

TEST_CASE("Free waits for the context's work when there is some", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUdeviceptr pointer = allocate(16);
    gpu.launch(gpu.stream(), 3000000);
    CHECK(cuMemFree(pointer) == CUDA_SUCCESS);
    CHECK(kernel_log().size() == 1);
}

TEST_CASE("Pointer attributes tell what memory is when asked", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUdeviceptr device = allocate(1000);
    void* host = nullptr;
    REQUIRE(cuMemHostAlloc(&host, 100, CU_MEMHOSTALLOC_PORTABLE) == CUDA_SUCCESS);
    unsigned type = 0;
    CHECK(cuPointerGetAttribute(&type, CU_POINTER_ATTRIBUTE_MEMORY_TYPE, device + 10) ==
          CUDA_SUCCESS);
    CHECK(type == CU_MEMORYTYPE_DEVICE);
    CHECK(cuPointerGetAttribute(&type, CU_POINTER_ATTRIBUTE_MEMORY_TYPE,
                                reinterpret_cast<CUdeviceptr>(host)) == CUDA_SUCCESS);
    CHECK(type == CU_MEMORYTYPE_HOST);
    int local = 0;
    const auto unknown = reinterpret_cast<CUdeviceptr>(&local);
    CHECK(cuPointerGetAttribute(&type, CU_POINTER_ATTRIBUTE_MEMORY_TYPE, unknown) ==
          CUDA_ERROR_INVALID_VALUE);
    CUpointer_attribute which[] = {CU_POINTER_ATTRIBUTE_MEMORY_TYPE};
    void* data[] = {&type};
    CHECK(cuPointerGetAttributes(1, which, data, unknown) == CUDA_SUCCESS);
    CHECK(type == 0);
    unsigned flags = 0;
    CHECK(cuMemHostGetFlags(&flags, host) == CUDA_SUCCESS);
    CHECK(flags == (CU_MEMHOSTALLOC_PORTABLE | CU_MEMHOSTALLOC_DEVICEMAP));
    CUdeviceptr base = 0;
    std::size_t bytes = 0;
    CHECK(cuMemGetAddressRange(&base, &bytes, device + 999) == CUDA_SUCCESS);
    CHECK(base == device);
    CHECK(bytes == 1000);
    CHECK(cuMemFreeHost(host) == CUDA_SUCCESS);
}

TEST_CASE("Host memory is registered once when it does not overlap", "[unit][simgpu]") {
    const SimGpu gpu;
    std::vector<char> memory(8192);
    CHECK(cuMemHostRegister(memory.data(), 8192, 0) == CUDA_SUCCESS);
    CHECK(cuMemHostRegister(memory.data() + 4096, 16, 0) ==
          CUDA_ERROR_HOST_MEMORY_ALREADY_REGISTERED);
    CUdeviceptr pointer = 0;
    CHECK(cuMemHostGetDevicePointer(&pointer, memory.data() + 5, 0) == CUDA_SUCCESS);
    CHECK(pointer == reinterpret_cast<CUdeviceptr>(memory.data() + 5));
    CHECK(cuMemHostUnregister(memory.data() + 4096) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuMemHostUnregister(memory.data()) == CUDA_SUCCESS);
    CHECK(cuMemHostUnregister(memory.data()) == CUDA_ERROR_HOST_MEMORY_NOT_REGISTERED);
}

TEST_CASE("Stream-ordered free keeps memory until earlier work is done when it is called",
          "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    CUdeviceptr pointer = 0;
    REQUIRE(cuMemAllocAsync(&pointer, 4096, stream) == CUDA_SUCCESS);
    gpu.launch(stream, 1000000);
    REQUIRE(cuMemsetD8Async(pointer, 1, 4096, stream) == CUDA_SUCCESS);  // ASan watches this
    CHECK(cuMemFreeAsync(pointer, stream) == CUDA_SUCCESS);
    CHECK(cuMemFreeAsync(pointer, stream) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuStreamSynchronize(stream) == CUDA_SUCCESS);
}
