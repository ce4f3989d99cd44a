// SPDX-License-Identifier: Apache-2.0
//
// Calls that SIMGPU_FAIL makes fail. The library reads it when it is loaded, so this program loads
// it after setting it.
#include <cuda.h>
#include <dlfcn.h>

#include <cstdlib>
#include <type_traits>

#include "tests/support/catch.h"
#include "tools/simgpu/api/injected_errors.h"

using urgengo::simgpu::parse_injected_errors;

TEST_CASE("Call fails when it is the one that the environment names", "[unit][simgpu]") {
    setenv("SIMGPU_FAIL",
           "cuMemAlloc_v2:2:2,cuMemAlloc_v2:3:700,cuCtxPushCurrent_v2:1:719,no_such:1:1,"
           "kernel:frail:2:1,kernel:frail:4:719,fault:faulty:1:700",
           1);
    void* const library = dlopen(SIMGPU_13_0, RTLD_NOW | RTLD_LOCAL);
    REQUIRE(library != nullptr);
    const auto find = [library]<typename F>(const char* name, std::type_identity<F>) {
        return reinterpret_cast<F*>(dlsym(library, name));
    };
    REQUIRE(find("cuInit", std::type_identity<decltype(cuInit)>())(0) == CUDA_SUCCESS);
    CUcontext context = nullptr;
    // It pushes the context too: only the program's own calls count.
    using CreateV2 = CUresult(CUcontext*, unsigned, CUdevice);
    REQUIRE(find("cuCtxCreate_v2", std::type_identity<CreateV2>())(&context, 0, 0) == CUDA_SUCCESS);
    auto* push = find("cuCtxPushCurrent_v2", std::type_identity<decltype(cuCtxPushCurrent)>());
    CHECK(push(context) == CUDA_ERROR_LAUNCH_FAILED);
    CHECK(push(context) == CUDA_SUCCESS);

    using Allocate = decltype(cuMemAlloc);
    auto* allocate = find("cuMemAlloc_v2", std::type_identity<Allocate>());
    CUdeviceptr pointer = 0;
    CHECK(allocate(&pointer, 64) == CUDA_SUCCESS);
    CHECK(pointer != 0);
    pointer = 7;
    CHECK(allocate(&pointer, 64) == CUDA_ERROR_OUT_OF_MEMORY);
    CHECK(pointer == 7);
    // However the program came by the function.
    void* found = nullptr;
    auto* ask = find("cuGetProcAddress_v2", std::type_identity<decltype(cuGetProcAddress)>());
    REQUIRE(ask("cuMemAlloc", &found, 12000, 0, nullptr) == CUDA_SUCCESS);
    CHECK(reinterpret_cast<Allocate*>(found)(&pointer, 64) == CUDA_ERROR_ILLEGAL_ADDRESS);
    CHECK(allocate(&pointer, 64) == CUDA_SUCCESS);
    CHECK(pointer != 7);

    // A kernel's launches count whichever entry carries them; some results break the context.
    CUmodule module = nullptr;
    REQUIRE(find("cuModuleLoadData", std::type_identity<decltype(cuModuleLoadData)>())(
                &module, "{}") == CUDA_SUCCESS);
    const auto get =
        find("cuModuleGetFunction", std::type_identity<decltype(cuModuleGetFunction)>());
    CUfunction sound = nullptr, frail = nullptr, faulty = nullptr;
    REQUIRE(get(&sound, module, "sound") == CUDA_SUCCESS);
    REQUIRE(get(&frail, module, "frail") == CUDA_SUCCESS);
    REQUIRE(get(&faulty, module, "faulty") == CUDA_SUCCESS);
    const auto launch_plain =
        [&, call = find("cuLaunchKernel", std::type_identity<decltype(cuLaunchKernel)>())](
            CUfunction f) { return call(f, 1, 1, 1, 1, 1, 1, 0, nullptr, nullptr, nullptr); };
    const auto launch_config =
        [&, call = find("cuLaunchKernelEx", std::type_identity<decltype(cuLaunchKernelEx)>())](
            CUfunction f) {
            const CUlaunchConfig config{1, 1, 1, 1, 1, 1, 0, nullptr, nullptr, 0};
            return call(&config, f, nullptr, nullptr);
        };
    auto* synchronize = find("cuCtxSynchronize", std::type_identity<CUresult()>());
    CHECK(launch_plain(frail) == CUDA_SUCCESS);
    CHECK(launch_plain(sound) == CUDA_SUCCESS);
    CHECK(launch_config(frail) == CUDA_ERROR_INVALID_VALUE);
    CHECK(launch_config(frail) == CUDA_SUCCESS);
    CHECK(synchronize() == CUDA_SUCCESS);
    CHECK(launch_plain(frail) == CUDA_ERROR_LAUNCH_FAILED);
    CHECK(launch_plain(sound) == CUDA_ERROR_LAUNCH_FAILED);
    CHECK(synchronize() == CUDA_ERROR_LAUNCH_FAILED);

    CUcontext another = nullptr;
    REQUIRE(find("cuCtxCreate_v2", std::type_identity<CreateV2>())(&another, 0, 0) == CUDA_SUCCESS);
    REQUIRE(find("cuModuleLoadData", std::type_identity<decltype(cuModuleLoadData)>())(
                &module, "{}") == CUDA_SUCCESS);
    REQUIRE(get(&faulty, module, "faulty") == CUDA_SUCCESS);
    CHECK(launch_plain(faulty) == CUDA_SUCCESS);
    CHECK(synchronize() == CUDA_ERROR_ILLEGAL_ADDRESS);
    CHECK(launch_plain(faulty) == CUDA_ERROR_ILLEGAL_ADDRESS);
}

TEST_CASE("Injected errors are read when they are well written", "[unit][simgpu]") {
    const auto errors = parse_injected_errors(
        "cuLaunchKernel:3:700,cuStreamSynchronize:1:719,kernel:a_b:2:1,fault:c:1:700");
    REQUIRE(errors);
    REQUIRE(errors->size() == 4);
    CHECK((*errors)[0].name == "cuLaunchKernel");
    CHECK((*errors)[0].call == 3);
    CHECK((*errors)[0].code == 700);
    CHECK((*errors)[1].code == 719);
    using On = urgengo::simgpu::InjectedError::On;
    CHECK((*errors)[1].on == On::kCall);
    CHECK((*errors)[2].on == On::kLaunch);
    CHECK((*errors)[2].name == "a_b");
    CHECK((*errors)[2].call == 2);
    CHECK((*errors)[3].on == On::kKernelEnd);
}

TEST_CASE("Injected errors are refused when they are not", "[unit][simgpu]") {
    const char* const text = GENERATE("cuInit", "cuInit:0:1", "cuInit:x:1", "cuInit:1:", ":1:1",
                                      "cuInit:1:1:1", "cuInit:1:-1", "kernel:1:1", "kernel::1:1",
                                      "fault:k:1:2", "kernel:k", "cuInit:1:1,,cuInit:2:1");
    const auto errors = parse_injected_errors(text);
    REQUIRE_FALSE(errors);
    CHECK(errors.error().find("accepted: <exported function>:") != std::string::npos);
}
