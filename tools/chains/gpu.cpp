// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/gpu.h"

#include <array>
#include <bit>

#include <fmt/format.h>

#include "tools/chains/files.h"

extern "C" const unsigned char urgengo_chains_fatbin[];

namespace urgengo::chains {

namespace {

// The module for the simulated GPU: what a block costs instead of what it computes, for the paper's
// RTX 3070 Ti (46 multiprocessors at 1.44 GHz, 128 fused multiply-adds a clock each, 608 GB/s) with
// four blocks of 256 threads on a multiprocessor. Computing: 4 * 256 * 4 / 128 = 32 clocks = 22.2
// ns an iteration; reading: 46 * 4 * 256 * 16 B at 608 GB/s = 1239 ns.
constexpr const char* kSimulatedImage = R"({"kernels": [
  {"name": "chains_comp", "block_ns_per_unit": 22.2, "unit_arg": 0, "unit_bytes": 4, "blocks_per_sm": 4, "stamps_arg": 1},
  {"name": "chains_mem", "block_ns_per_unit": 1239, "unit_arg": 0, "unit_bytes": 4, "blocks_per_sm": 4, "stamps_arg": 1}
]})";

constexpr unsigned kMemoryInputBytes = 256u << 20;  // a power of two, larger than any cache
constexpr unsigned kBytesPerRead = 16;

}  // namespace

void check_cuda(CUresult result, const char* call) {
    if (result == CUDA_SUCCESS) return;
    const char* name = nullptr;
    const char* description = nullptr;
    cuGetErrorName(result, &name);
    cuGetErrorString(result, &description);
    throw CudaError(fmt::format("{}: {} ({}): {}", call, name ? name : "unknown error",
                                static_cast<int>(result),
                                description ? description : "no description"));
}

DeviceBuffer::DeviceBuffer(std::size_t size_bytes) {
    CHAINS_CUDA(cuMemAlloc(&pointer_, size_bytes));
}

DeviceBuffer::~DeviceBuffer() {
    if (pointer_) cuMemFree(pointer_);
}

DeviceBuffer& DeviceBuffer::operator=(DeviceBuffer&& other) noexcept {
    std::swap(pointer_, other.pointer_);
    return *this;
}

Gpu::Gpu(SyncMode sync) {
    CHAINS_CUDA(cuInit(0));
    CHAINS_CUDA(cuDeviceGet(&device_, 0));
    std::array<char, 256> name{};
    CHAINS_CUDA(cuDeviceGetName(name.data(), static_cast<int>(name.size()), device_));
    name_ = name.data();
    simulated_ = name_.find("Simulated") != std::string::npos;
    CHAINS_CUDA(cuDeviceGetAttribute(&num_sms_, CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT, device_));
    int version = 0;
    CHAINS_CUDA(cuDriverGetVersion(&version));
    cuda_driver_version_ = fmt::format("{}.{}", version / 1000, version % 1000 / 10);
    if (!simulated_) {
        try {
            kernel_driver_version_ =
                parse_kernel_driver_version(read_file("/proc/driver/nvidia/version"));
        } catch (const std::runtime_error&) {
            // Not there inside some containers; it is only reported.
        }
    }

    if (sync == SyncMode::kBlock) {
        CHAINS_CUDA(cuDevicePrimaryCtxSetFlags(device_, CU_CTX_SCHED_BLOCKING_SYNC));
    }
    CHAINS_CUDA(cuDevicePrimaryCtxRetain(&context_, device_));
    bind_thread();
    CHAINS_CUDA(cuModuleLoadData(&module_, image()));
    CHAINS_CUDA(cuModuleGetFunction(&compute_, module_, kernel_name(KernelKind::kCompute)));
    CHAINS_CUDA(cuModuleGetFunction(&memory_, module_, kernel_name(KernelKind::kMemory)));
}

Gpu::~Gpu() {
    memory_input_ = DeviceBuffer();
    if (module_) cuModuleUnload(module_);
    if (context_) cuDevicePrimaryCtxRelease(device_);
}

const void* Gpu::image() const {
    return simulated_ ? static_cast<const void*>(kSimulatedImage) : urgengo_chains_fatbin;
}

void Gpu::bind_thread() const {
    CHAINS_CUDA(cuCtxSetCurrent(context_));
}

CUfunction Gpu::function(const char* name) const {
    CUfunction function = nullptr;
    CHAINS_CUDA(cuModuleGetFunction(&function, module_, name));
    return function;
}

void Gpu::prepare_memory_input() {
    if (memory_input_.get()) return;
    memory_input_ = DeviceBuffer(kMemoryInputBytes);
    CHAINS_CUDA(cuMemsetD32(memory_input_.get(), std::bit_cast<unsigned>(1.0f),
                            kMemoryInputBytes / sizeof(float)));
}

void Gpu::launch(const Kernel& kernel, int grid, CUstream stream, CUdeviceptr results,
                 unsigned blocks_before) const {
    int iterations = kernel.iterations;
    CUdeviceptr input = memory_input_.get();
    unsigned index_mask = kMemoryInputBytes / kBytesPerRead - 1;
    // chains_comp takes the first three.
    void* parameters[] = {&iterations, &results, &blocks_before, &input, &index_mask};
    const CUfunction function = kernel.kind == KernelKind::kCompute ? compute_ : memory_;
    const CUresult result =
        cuLaunchKernel(function, static_cast<unsigned>(grid), 1, 1,
                       static_cast<unsigned>(kernel.block), 1, 1, 0, stream, parameters, nullptr);
    if (result == CUDA_SUCCESS) return;
    check_cuda(result, fmt::format("cuLaunchKernel({}, {} blocks of {} threads, {} iterations)",
                                   kernel_name(kernel.kind), grid, kernel.block, iterations)
                           .c_str());
}

Stream::Stream() {
    CHAINS_CUDA(cuStreamCreate(&stream_, CU_STREAM_NON_BLOCKING));
}

Stream::~Stream() {
    if (stream_) cuStreamDestroy(stream_);
}

Event::Event() {
    CHAINS_CUDA(cuEventCreate(&event_, CU_EVENT_DEFAULT));
}

Event::~Event() {
    if (event_) cuEventDestroy(event_);
}

double Event::ms_since(const Event& start) const {
    float ms = 0;
    CHAINS_CUDA(cuEventElapsedTime(&ms, start.event_, event_));
    return ms;
}

}  // namespace urgengo::chains
