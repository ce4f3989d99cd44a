// SPDX-License-Identifier: Apache-2.0
#include "tests/interposer/gpu.h"

#include <sys/prctl.h>

#include <cstring>

#include "tests/interposer/twin.h"

namespace twin {
namespace {

constexpr unsigned kWideThreads = 1024;

/// The fewest blocks that fill the GPU.
unsigned num_wide_blocks() {
    constexpr unsigned kSimulated = 46;  // one for each SM, as the image says
    int num_sms = 0, threads_per_sm = 0;
    if (simulated() ||
        cuDeviceGetAttribute(&num_sms, CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT, 0) ||
        cuDeviceGetAttribute(&threads_per_sm, CU_DEVICE_ATTRIBUTE_MAX_THREADS_PER_MULTIPROCESSOR,
                             0))
        return kSimulated;
    return static_cast<unsigned>(num_sms) * static_cast<unsigned>(threads_per_sm) / kWideThreads;
}

// For the tests: whether there is a GPU, and how large launch_wide()'s launches are.
int about_gpu(const Arguments&) {
    if (cuInit(0) != CUDA_SUCCESS) return 1;
    say("%u", num_wide_blocks());
    return 0;
}

const Scenario s1("about_gpu", about_gpu);

}  // namespace

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

CUcontext make_context() {
    using Create = CUresult (*)(CUcontext*, unsigned, CUdevice);
    static const auto create = reinterpret_cast<Create>(entry_point("cuCtxCreate", 3020, 0));
    CUcontext context = nullptr;
    MUST(create(&context, 0, 0));
    return context;
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
    static const unsigned num_blocks = num_wide_blocks();
    return cuLaunchKernel(wide, num_blocks, 1, 1, kWideThreads, 1, 1, 0, stream, nullptr, nullptr);
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
