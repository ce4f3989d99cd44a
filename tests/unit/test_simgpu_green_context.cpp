// SPDX-License-Identifier: Apache-2.0
//
// Green contexts of the simulated driver.
#include "tests/unit/test_simgpu_support.h"

#if CUDA_VERSION >= 12050

TEST_CASE("Green context shares all but its streams with the primary one when it is used",
          "[unit][simgpu]") {
    const SimGpu gpu;
    CUdevResource all{};
    CUdevResource groups[8]{};
    CUdevResource rest{};
    REQUIRE(cuDeviceGetDevResource(0, &all, CU_DEV_RESOURCE_TYPE_SM) == CUDA_SUCCESS);
    CHECK(all.sm.smCount == 46);
    unsigned count = 0;
    REQUIRE(cuDevSmResourceSplitByCount(nullptr, &count, &all, nullptr, 0, 11) == CUDA_SUCCESS);
    CHECK(count == 3);  // of 12: SMs come in pairs
    REQUIRE(cuDevSmResourceSplitByCount(groups, &count, &all, &rest, 0, 11) == CUDA_SUCCESS);
    CHECK(groups[2].sm.smCount == 12);
    CHECK(rest.sm.smCount == 10);
    CHECK(cuDevSmResourceSplitByCount(groups, &count, &all, &rest, 0, 47) ==
          CUDA_ERROR_INVALID_VALUE);

    CUdevResourceDesc desc = nullptr;
    CUgreenCtx green = nullptr;
    CUcontext context = nullptr;
    REQUIRE(cuDevResourceGenerateDesc(&desc, groups, 2) == CUDA_SUCCESS);
    CHECK(cuGreenCtxCreate(&green, desc, 0, 0) == CUDA_ERROR_INVALID_VALUE);
    REQUIRE(cuGreenCtxCreate(&green, desc, 0, CU_GREEN_CTX_DEFAULT_STREAM) == CUDA_SUCCESS);
    REQUIRE(cuGreenCtxGetDevResource(green, &rest, CU_DEV_RESOURCE_TYPE_SM) == CUDA_SUCCESS);
    CHECK(rest.sm.smCount == 24);
    CUstream stream = nullptr;
    CHECK(cuGreenCtxStreamCreate(&stream, green, CU_STREAM_DEFAULT, 0) == CUDA_ERROR_INVALID_VALUE);
    REQUIRE(cuGreenCtxStreamCreate(&stream, green, CU_STREAM_NON_BLOCKING, -2) == CUDA_SUCCESS);
    CUgreenCtx found = nullptr;
    REQUIRE(cuStreamGetGreenCtx(stream, &found) == CUDA_SUCCESS);
    CHECK(found == green);
    REQUIRE(cuStreamGetGreenCtx(nullptr, &found) == CUDA_SUCCESS);
    CHECK(found == nullptr);

    // The primary context's function runs there, and its synchronisation waits for it.
    REQUIRE(gpu.launch(stream, 20000000) == CUDA_SUCCESS);
    REQUIRE(cuCtxSynchronize() == CUDA_SUCCESS);
    CHECK(cuStreamQuery(stream) == CUDA_SUCCESS);
    REQUIRE(kernel_log().size() == 1);
    CHECK(kernel_log()[0].priority == -2);

    REQUIRE(cuCtxFromGreenCtx(&context, green) == CUDA_SUCCESS);
    REQUIRE(cuCtxPushCurrent(context) == CUDA_SUCCESS);
    CUdeviceptr memory = 0;
    REQUIRE(cuMemAlloc(&memory, 64) == CUDA_SUCCESS);
    REQUIRE(gpu.launch(nullptr, 1000) == CUDA_SUCCESS);
    CHECK(cuCtxDestroy(context) == CUDA_ERROR_INVALID_CONTEXT);
    REQUIRE(cuGreenCtxDestroy(green) == CUDA_SUCCESS);
    CHECK(gpu.launch(stream, 1000) == CUDA_ERROR_INVALID_HANDLE);
    CHECK(cuGreenCtxDestroy(green) != CUDA_SUCCESS);
    CUcontext current = nullptr;
    REQUIRE(cuCtxGetCurrent(&current) == CUDA_SUCCESS);
    CHECK(current == gpu.context);
    CHECK(cuMemFree(memory) == CUDA_SUCCESS);  // the primary context's
}

#endif
