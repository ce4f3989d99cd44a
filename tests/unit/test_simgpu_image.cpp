// SPDX-License-Identifier: Apache-2.0
//
// Images that nvcc made of data/image_kernels.cu, as the simulated driver reads them.
#include <fstream>
#include <iterator>

#include "tests/unit/test_simgpu_support.h"

namespace {

std::string read_image(const std::string& name) {
    std::ifstream file(std::string(SIMGPU_IMAGES) + "/" + name, std::ios::binary);
    std::string text{std::istreambuf_iterator<char>(file), {}};
    INFO(name);
    REQUIRE_FALSE(text.empty());
    return text;
}

struct Param {
    std::size_t offset;
    std::size_t bytes;
    bool operator==(const Param&) const = default;
};

std::vector<Param> params_of(CUfunction function) {
    std::vector<Param> params;
    Param param{};
    while (cuFuncGetParamInfo(function, params.size(), &param.offset, &param.bytes) ==
           CUDA_SUCCESS) {
        params.push_back(param);
    }
    return params;
}

int attribute(CUfunction function, CUfunction_attribute which) {
    int value = -1;
    REQUIRE(cuFuncGetAttribute(&value, which, function) == CUDA_SUCCESS);
    return value;
}

// What the compiler's alignment rules give for the parameters of `mixed`.
const std::vector<Param> kMixed = {{0, 8}, {8, 1}, {10, 2}, {16, 8}, {24, 32}, {64, 16}, {80, 8}};

}  // namespace

TEST_CASE("Parameters are those that nvcc laid out when an image is loaded", "[unit][simgpu]") {
    const SimGpu gpu;
    const std::string name = GENERATE(std::string("old.cubin"), std::string("new.cubin"),
                                      std::string("kernels.ptx"), std::string("plain.fatbin"));
    INFO(name);
    const std::string image = read_image(name);
    CUmodule module = nullptr;
    REQUIRE(cuModuleLoadData(&module, image.data()) == CUDA_SUCCESS);
    CUfunction function = nullptr;
    REQUIRE(cuModuleGetFunction(&function, module, "mixed") == CUDA_SUCCESS);
    CHECK(params_of(function) == kMixed);
    REQUIRE(cuModuleGetFunction(&function, module, "no_params") == CUDA_SUCCESS);
    CHECK(params_of(function).empty());
    REQUIRE(cuModuleGetFunction(&function, module, "bounded") == CUDA_SUCCESS);
    CHECK(params_of(function) == std::vector<Param>{{0, 8}});
    CHECK(attribute(function, CU_FUNC_ATTRIBUTE_MAX_THREADS_PER_BLOCK) == 128);
    if (name != "kernels.ptx") {  // registers and shared memory are decided by the assembler
        CHECK(attribute(function, CU_FUNC_ATTRIBUTE_SHARED_SIZE_BYTES) >= 256);
        CHECK(attribute(function, CU_FUNC_ATTRIBUTE_NUM_REGS) < 32);
    }
    CHECK(cuModuleGetFunction(&function, module, "absent") == CUDA_ERROR_NOT_FOUND);

    CUlibrary library = nullptr;
    REQUIRE(cuLibraryLoadData(&library, image.data(), nullptr, nullptr, 0, nullptr, nullptr, 0) ==
            CUDA_SUCCESS);
    CUkernel kernel = nullptr;
    REQUIRE(cuLibraryGetKernel(&kernel, library, "mixed") == CUDA_SUCCESS);
    Param last{};
    CHECK(cuKernelGetParamInfo(kernel, 6, &last.offset, &last.bytes) == CUDA_SUCCESS);
    CHECK(last == kMixed[6]);
    CHECK(cuKernelGetParamInfo(kernel, 7, &last.offset, &last.bytes) == CUDA_ERROR_INVALID_VALUE);
    CHECK(cuLibraryGetKernel(&kernel, library, "absent") == CUDA_ERROR_NOT_FOUND);
}

TEST_CASE("Parameters are unknown when the image is compressed", "[unit][simgpu]") {
    const SimGpu gpu;
    const std::string image = read_image("compressed.fatbin");
    CUmodule module = nullptr;
    REQUIRE(cuModuleLoadData(&module, image.data()) == CUDA_SUCCESS);
    CUfunction function = nullptr;
    REQUIRE(cuModuleGetFunction(&function, module, "mixed") == CUDA_SUCCESS);
    std::size_t offset = 0;
    CHECK(cuFuncGetParamInfo(function, 0, &offset, nullptr) == CUDA_ERROR_NOT_SUPPORTED);
    REQUIRE(cuLaunchKernel(function, 1, 1, 1, 32, 1, 1, 0, nullptr, nullptr, nullptr) ==
            CUDA_SUCCESS);
    REQUIRE(cuCtxSynchronize() == CUDA_SUCCESS);
    CHECK(kernel_log().size() == 1);
}

TEST_CASE("Wrapped fat binary is read when a host program passes its own", "[unit][simgpu]") {
    const SimGpu gpu;
    const std::string image = read_image("plain.fatbin");
    const struct {
        unsigned magic = 0x466243b1;
        unsigned version = 1;
        const void* data;
        const void* file = nullptr;
    } wrapper{.data = image.data()};
    CUmodule module = nullptr;
    REQUIRE(cuModuleLoadFatBinary(&module, &wrapper) == CUDA_SUCCESS);
    CUfunction function = nullptr;
    REQUIRE(cuModuleGetFunction(&function, module, "mixed") == CUDA_SUCCESS);
    CHECK(params_of(function) == kMixed);
}

TEST_CASE("Parameters are read when the PTX is written by hand", "[unit][simgpu]") {
    const SimGpu gpu;
    CUmodule module = nullptr;
    REQUIRE(cuModuleLoadData(&module, R"(// by hand
.version 8.0 /* .entry not_this ( .param .u8 x ) */
.target sm_80
.address_size 64
.visible .entry by_hand(.param .u8 a, .param .u64 .ptr .global .align 1 b, // pointer
  .param .b32 c[3])
.maxntid 64, 2
{ ret; }
.func (.param .b32 r) helper(.param .b32 x) { ret; })") == CUDA_SUCCESS);
    CUfunction function = nullptr;
    REQUIRE(cuModuleGetFunction(&function, module, "by_hand") == CUDA_SUCCESS);
    CHECK(params_of(function) == std::vector<Param>{{0, 1}, {8, 8}, {16, 12}});
    CHECK(attribute(function, CU_FUNC_ATTRIBUTE_MAX_THREADS_PER_BLOCK) == 128);
    CHECK(cuModuleGetFunction(&function, module, "helper") == CUDA_ERROR_NOT_FOUND);
    CHECK(cuModuleGetFunction(&function, module, "not_this") == CUDA_ERROR_NOT_FOUND);
}
