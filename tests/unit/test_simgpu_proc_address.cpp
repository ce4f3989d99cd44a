// SPDX-License-Identifier: Apache-2.0
//
// cuGetProcAddress of the simulated driver.
#include <dlfcn.h>

#include "tests/unit/test_simgpu_support.h"

namespace {

void* ask(const char* name, int version, cuuint64_t flags = 0,
          CUdriverProcAddressQueryResult expected = CU_GET_PROC_ADDRESS_SUCCESS) {
    void* function = nullptr;
    CUdriverProcAddressQueryResult status{};
    CHECK(cuGetProcAddress_v2(name, &function, version, flags, &status) == CUDA_SUCCESS);
    CHECK(status == expected);
    return function;
}

void* exported(const char* symbol) {
    static void* const library = dlopen("libcuda.so.1", RTLD_LAZY | RTLD_NOLOAD);
    REQUIRE(library != nullptr);
    void* const address = dlsym(library, symbol);
    REQUIRE(address != nullptr);
    return address;
}

}  // namespace

TEST_CASE("Proc address is the newest ABI at or below the version when there are several",
          "[unit][simgpu]") {
    CHECK(ask("cuCtxCreate", 3020) == exported("cuCtxCreate_v2"));
    CHECK(ask("cuCtxCreate", 11030) == exported("cuCtxCreate_v2"));
    CHECK(ask("cuCtxCreate", 12000) == exported("cuCtxCreate_v3"));
    CHECK(ask("cuMemAlloc", 13000) == exported("cuMemAlloc_v2"));
    CHECK(ask("cuGetProcAddress", 11030) == exported("cuGetProcAddress"));
    CHECK(ask("cuGetProcAddress", 12000) == exported("cuGetProcAddress_v2"));
    CHECK(ask("cuEventElapsedTime", 12080) == exported("cuEventElapsedTime_v2"));
    CHECK(ask("cuStreamGetCtx", 12040) == exported("cuStreamGetCtx"));
    CHECK(ask("cuStreamGetCtx", 12050) == exported("cuStreamGetCtx_v2"));
    CHECK(ask("cuCtxSynchronize", 12000) == exported("cuCtxSynchronize"));
    CHECK(ask("cuCtxSynchronize", 13000) == exported("cuCtxSynchronize_v2"));
}

TEST_CASE("Proc address follows the default stream's flavour when there is one for it",
          "[unit][simgpu]") {
    constexpr auto kPerThread = CU_GET_PROC_ADDRESS_PER_THREAD_DEFAULT_STREAM;
    CHECK(ask("cuLaunchKernel", 7000) == exported("cuLaunchKernel"));
    CHECK(ask("cuLaunchKernel", 7000, CU_GET_PROC_ADDRESS_LEGACY_STREAM) ==
          exported("cuLaunchKernel"));
    CHECK(ask("cuLaunchKernel", 7000, kPerThread) == exported("cuLaunchKernel_ptsz"));
    // Where there is a per-thread one, too old a version does not get the plain one.
    CHECK(ask("cuLaunchKernel", 4000, kPerThread, CU_GET_PROC_ADDRESS_VERSION_NOT_SUFFICIENT) ==
          nullptr);
    CHECK(ask("cuMemcpyHtoD", 7000, kPerThread) == exported("cuMemcpyHtoD_v2_ptds"));
    CHECK(ask("cuStreamWaitValue32", 8000, kPerThread) == exported("cuStreamWaitValue32_ptsz"));
    CHECK(ask("cuStreamWaitValue32", 12000, kPerThread) == exported("cuStreamWaitValue32_v2_ptsz"));
    CHECK(ask("cuMemAlloc", 13000, kPerThread) == exported("cuMemAlloc_v2"));
}

TEST_CASE("Proc address is null and says why when the name or the version is wrong",
          "[unit][simgpu]") {
    constexpr auto kNotFound = CU_GET_PROC_ADDRESS_SYMBOL_NOT_FOUND;
    CHECK(ask("cuLaunchKerne", 13000, 0, kNotFound) == nullptr);
    CHECK(ask("cuMemAlloc_v2", 13000, 0, kNotFound) == nullptr);
    CHECK(ask("", 0, 0, kNotFound) == nullptr);
    CHECK(ask("cuLaunchKernelEx", 11000, 0, CU_GET_PROC_ADDRESS_VERSION_NOT_SUFFICIENT) == nullptr);
    void* function = &function;
    const auto v1 = reinterpret_cast<CUresult (*)(const char*, void**, int, cuuint64_t)>(
        exported("cuGetProcAddress"));
    CHECK(v1("cuLaunchKerne", &function, 13000, 0) == CUDA_ERROR_NOT_FOUND);
    CHECK(function == &function);
}

TEST_CASE("Proc address is refused when the request makes no sense", "[unit][simgpu]") {
    void* function = nullptr;
    const auto ask_bare = [&function](const char* name, int version, cuuint64_t flags) {
        return cuGetProcAddress_v2(name, &function, version, flags, nullptr);
    };
    CHECK(ask_bare("cuInit", 13000, 4) == CUDA_ERROR_INVALID_VALUE);
    CHECK(ask_bare("cuInit", 13010, 0) == CUDA_ERROR_INVALID_VALUE);
    CHECK(ask_bare(nullptr, 13000, 0) == CUDA_ERROR_INVALID_VALUE);
}

TEST_CASE("Export tables are not there when asked for", "[unit][simgpu]") {
    const void* table = &table;
    const CUuuid id{};
    CHECK(cuGetExportTable(&table, &id) == CUDA_ERROR_NOT_FOUND);
    CHECK(table == nullptr);
}
