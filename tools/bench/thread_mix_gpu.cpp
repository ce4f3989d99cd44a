// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/thread_mix_gpu.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>

#include "tools/bench/bench_config.h"
#include "tools/log/log.h"

extern "C" const unsigned char urgengo_bench_fatbin[];

namespace urgengo::bench {

void mix_must(CUresult result, const char* call) {
    if (result == CUDA_SUCCESS) return;
    tools::log_error("{} answers {}", call, static_cast<int>(result));
    std::exit(1);
}

MixGpu::MixGpu() {
    MIX_MUST(cuInit(0));
    MIX_MUST(cuDeviceGet(&device_, 0));
    MIX_MUST(cuDevicePrimaryCtxRetain(&context_, device_));
    make_current();
    if (!load_simulated()) load_real();
}

/// @returns false if the GPU is a real one, to which a cost table is no image
bool MixGpu::load_simulated() {
    std::string image = R"({"kernels": [)";
    for (int i = 0; i < kKernels; ++i) {
        image += fmt::format(R"({}{{"name": "mix{}", "block_ns_per_unit": 1000, "unit_arg": 0, )"
                             R"("unit_bytes": 4, "param_bytes": [4, 8]}})",
                             i == 0 ? "" : ", ", i);
    }
    image += "]}";
    CUmodule module = nullptr;
    if (cuModuleLoadData(&module, image.c_str()) != CUDA_SUCCESS) return false;
    for (int i = 0; i < kKernels; ++i) {
        MIX_MUST(cuModuleGetFunction(&kernels_[i], module, fmt::format("mix{}", i).c_str()));
    }
    int num_sms = 0;
    MIX_MUST(cuDeviceGetAttribute(&num_sms, CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT, device_));
    blocks_ = static_cast<unsigned>(num_sms);
    return true;
}

void MixGpu::load_real() {
    CUmodule module = nullptr;
    MIX_MUST(cuModuleLoadData(&module, urgengo_bench_fatbin));
    int num_sms = 0, num_threads = 0;
    MIX_MUST(cuDeviceGetAttribute(&num_sms, CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT, device_));
    MIX_MUST(cuDeviceGetAttribute(&num_threads, CU_DEVICE_ATTRIBUTE_MAX_THREADS_PER_MULTIPROCESSOR,
                                  device_));
    threads_ = 256;
    blocks_ = static_cast<unsigned>(num_sms) * static_cast<unsigned>(num_threads) / threads_;
    for (CUfunction& kernel : kernels_) {
        MIX_MUST(cuModuleGetFunction(&kernel, module, kKernel));
    }
    constexpr unsigned kFew = 20'000, kMany = 120'000;
    measure_us(kMany);  // wakes the clocks
    const double few_us = measure_us(kFew), many_us = measure_us(kMany);
    units_per_us_ = (kMany - kFew) / std::max(1.0, many_us - few_us);
}

/// @returns how long a kernel of so many units takes
double MixGpu::measure_us(unsigned units) const {
    constexpr int kLaunches = 50;
    const CUstream stream = make_stream();
    CUdeviceptr nowhere = 0;
    void* parameters[] = {&units, &nowhere};
    const auto begin = std::chrono::steady_clock::now();
    for (int i = 0; i < kLaunches; ++i) {
        MIX_MUST(cuLaunchKernel(kernels_[0], blocks_, 1, 1, threads_, 1, 1, 0, stream, parameters,
                                nullptr));
    }
    MIX_MUST(cuStreamSynchronize(stream));
    const std::chrono::duration<double, std::micro> time = std::chrono::steady_clock::now() - begin;
    MIX_MUST(cuStreamDestroy(stream));
    return time.count() / kLaunches;
}

CUstream MixGpu::make_stream() const {
    CUstream stream = nullptr;
    MIX_MUST(cuStreamCreate(&stream, CU_STREAM_NON_BLOCKING));
    return stream;
}

CUevent MixGpu::make_event() const {
    CUevent event = nullptr;
    MIX_MUST(cuEventCreate(&event, CU_EVENT_DISABLE_TIMING));
    return event;
}

void MixGpu::launch(int which, unsigned kernel_us, CUstream stream) const {
    auto units = static_cast<unsigned>(std::lround(kernel_us * units_per_us_));
    CUdeviceptr nowhere = 0;
    void* parameters[] = {&units, &nowhere};
    MIX_MUST(cuLaunchKernel(kernels_[which % kKernels], blocks_, 1, 1, threads_, 1, 1, 0, stream,
                            parameters, nullptr));
}

std::string MixGpu::name() const {
    char text[256] = {};
    MIX_MUST(cuDeviceGetName(text, sizeof text - 1, device_));
    return text;
}

}  // namespace urgengo::bench
