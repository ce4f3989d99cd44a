// SPDX-License-Identifier: Apache-2.0
#include "tests/interposer/gpu.h"

#include <sys/prctl.h>

#include <cstring>

#include "tests/interposer/twin.h"

namespace twin {

const char* const kImage = R"({"kernels": [
    {"name": "tiny", "block_ns": 10000},
    {"name": "wide", "block_ns": 300000, "blocks_per_sm": 1},
    {"name": "long", "block_ns": 5000000, "blocks_per_sm": 1},
    {"name": "very_long", "block_ns": 50000000, "blocks_per_sm": 1}],
    "default": {"block_ns": 5000}})";

// The simulated GPU runs UrgenGo's mark kernel for real; to a program it is a kernel like others.
const char* const kStoreName = "urgengo_mark";

Gpu::Gpu() {
    MUST(cuInit(0));
    MUST(cuDevicePrimaryCtxRetain(&context, 0));
    MUST(cuCtxSetCurrent(context));
    MUST(cuModuleLoadData(&module, kImage));
    store = function(kStoreName);
    tiny = function("tiny");
    wide = function("wide");
}

Gpu::~Gpu() {
    cuDevicePrimaryCtxRelease(0);
}

CUfunction Gpu::function(const char* name) const {
    CUfunction f = nullptr;
    MUST(cuModuleGetFunction(&f, module, name));
    return f;
}

CUstream make_stream(unsigned flags, int priority) {
    CUstream stream = nullptr;
    MUST(cuStreamCreateWithPriority(&stream, flags, priority));
    return stream;
}

std::uint64_t* make_mapped(std::size_t num_words) {
    void* memory = nullptr;
    MUST(cuMemHostAlloc(&memory, num_words * sizeof(std::uint64_t),
                        CU_MEMHOSTALLOC_PORTABLE | CU_MEMHOSTALLOC_DEVICEMAP));
    std::memset(memory, 0, num_words * sizeof(std::uint64_t));
    return static_cast<std::uint64_t*>(memory);
}

CUresult launch_store(CUfunction store, std::uint64_t* to, std::uint64_t value, CUstream stream) {
    CUdeviceptr d_to = on_gpu(to);
    std::uint64_t tag = value;
    void* parameters[] = {&d_to, &value, &tag};
    return cuLaunchKernel(store, 1, 1, 1, 1, 1, 1, 0, stream, parameters, nullptr);
}

CUresult launch_tiny(CUfunction tiny, CUstream stream) {
    return cuLaunchKernel(tiny, 4, 1, 1, 64, 1, 1, 0, stream, nullptr, nullptr);
}

CUresult launch_wide(CUfunction wide, CUstream stream) {
    return cuLaunchKernel(wide, 46, 1, 1, 1024, 1, 1, 0, stream, nullptr, nullptr);
}

void name_this_thread(const std::string& name) {
    prctl(PR_SET_NAME, name.c_str());
}

void* entry_point(const char* name, int version, cuuint64_t flags) {
    void* function = nullptr;
    CUdriverProcAddressQueryResult status;
    MUST(cuGetProcAddress(name, &function, version, flags, &status));
    return function;
}

}  // namespace twin
