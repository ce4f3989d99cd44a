// SPDX-License-Identifier: Apache-2.0
//
// The simulated driver at no cost (SIMGPU_ZERO_COST=1): its own program, because the choice is one
// for the whole process.
#include <dirent.h>

#include <cstdlib>

#include "tests/unit/test_simgpu_support.h"

namespace {

[[maybe_unused]] const int g_asked = setenv("SIMGPU_ZERO_COST", "1", 1);

int num_threads() {
    int count = 0;
    DIR* const tasks = opendir("/proc/self/task");
    while (const dirent* entry = readdir(tasks)) count += entry->d_name[0] != '.';
    closedir(tasks);
    return count;
}

}  // namespace

TEST_CASE("Calls return at once when nothing costs anything", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    CUevent event = nullptr;
    CUevent late = nullptr;
    REQUIRE(cuEventCreate(&event, CU_EVENT_DEFAULT) == CUDA_SUCCESS);
    REQUIRE(cuEventCreate(&late, CU_EVENT_DEFAULT) == CUDA_SUCCESS);
    for (int i = 0; i < 1000; ++i) REQUIRE(gpu.launch(stream, 4000000000U) == CUDA_SUCCESS);
    CHECK(cuEventRecord(event, stream) == CUDA_SUCCESS);
    CHECK(cuEventQuery(event) == CUDA_SUCCESS);
    CHECK(cuStreamQuery(stream) == CUDA_SUCCESS);
    CHECK(cuStreamQuery(nullptr) == CUDA_SUCCESS);
    CHECK(cuStreamSynchronize(stream) == CUDA_SUCCESS);
    CHECK(cuEventSynchronize(event) == CUDA_SUCCESS);
    CHECK(cuCtxSynchronize() == CUDA_SUCCESS);
    float ms = -1;
    CHECK(cuEventRecord(late, stream) == CUDA_SUCCESS);
    CHECK(cuEventElapsedTime(&ms, event, late) == CUDA_SUCCESS);
    CHECK(ms == 0);
    CHECK(cuLaunchKernel(nullptr, 1, 1, 1, 1, 1, 1, 0, stream, nullptr, nullptr) ==
          CUDA_ERROR_INVALID_HANDLE);
    CHECK(kernel_log().empty());
    CHECK(num_threads() == 1);
}

TEST_CASE("Effects are there when the call returns and nothing costs anything", "[unit][simgpu]") {
    const SimGpu gpu;
    const CUstream stream = gpu.stream();
    const CUfunction mark = gpu.function("urgengo_mark");
    std::uint64_t* words = nullptr;
    REQUIRE(cuMemAllocHost(reinterpret_cast<void**>(&words), 256) == CUDA_SUCCESS);
    auto line = reinterpret_cast<CUdeviceptr>(words);
    std::uint64_t word0 = 0xabcdef;
    std::uint64_t tag = 0x12345;
    void* params[] = {&line, &word0, &tag};
    REQUIRE(cuLaunchKernel(mark, 1, 1, 1, 1, 1, 1, 0, stream, params, nullptr) == CUDA_SUCCESS);
    CHECK(words[0] == 0xabcdef);
    CHECK((words[1] & 0xffff) == 0x2345);
    const std::uint64_t first = words[1];

    word0 = 7;
    CUlaunchConfig config{1, 1, 1, 1, 1, 1, 0, stream, nullptr, 0};
    REQUIRE(cuLaunchKernelEx(&config, mark, params, nullptr) == CUDA_SUCCESS);
    CHECK(words[0] == 7);
    CHECK((words[1] >> 16) >= (first >> 16));

    CHECK(cuStreamWaitValue32(stream, line + 128, 1, CU_STREAM_WAIT_VALUE_EQ) == CUDA_SUCCESS);
    CHECK(cuStreamWriteValue64(stream, line + 128, 99, 0) == CUDA_SUCCESS);
    CHECK(words[16] == 99);
    const std::uint64_t source = 5;
    CHECK(cuMemcpyHtoDAsync(line + 136, &source, sizeof source, stream) == CUDA_SUCCESS);
    CHECK(words[17] == 5);
    bool called = false;
    CHECK(cuLaunchHostFunc(
              stream, [](void* flag) { *static_cast<bool*>(flag) = true; }, &called) ==
          CUDA_SUCCESS);
    CHECK(called);
}
