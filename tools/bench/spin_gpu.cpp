// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/spin_gpu.h"

#include <chrono>
#include <cmath>
#include <cstdlib>

#include "tools/bench/bench_config.h"
#include "tools/log/log.h"

extern "C" const unsigned char urgengo_bench_fatbin[];

namespace urgengo::bench {

void must(CUresult result, const char* call) {
    if (result == CUDA_SUCCESS) return;
    tools::log_error("{} answers {}", call, static_cast<int>(result));
    std::exit(1);
}

SpinGpu::SpinGpu() {
    CUmodule module = nullptr;
    MUST(cuInit(0));
    MUST(cuDeviceGet(&device_, 0));
    MUST(cuDevicePrimaryCtxRetain(&context_, device_));
    make_current();
    MUST(cuModuleLoadData(&module, urgengo_bench_fatbin));
    MUST(cuModuleGetFunction(&kernel_, module, kKernel));
}

CUstream SpinGpu::make_stream() const {
    CUstream stream = nullptr;
    MUST(cuStreamCreate(&stream, CU_STREAM_NON_BLOCKING));
    return stream;
}

void SpinGpu::launch(unsigned iterations, CUstream stream) const {
    CUdeviceptr nowhere = 0;
    void* parameters[] = {&iterations, &nowhere};
    MUST(cuLaunchKernel(kernel_, 1, 1, 1, kKernelThreads, 1, 1, 0, stream, parameters, nullptr));
}

std::string SpinGpu::name() const {
    char text[256] = {};
    MUST(cuDeviceGetName(text, sizeof text - 1, device_));
    return text;
}

unsigned Pace::iterations(double period_us) const {
    const double iterations = (period_us - fixed_us) / us_per_iteration;
    if (iterations < 0) {
        tools::log_error(
            "an empty kernel takes {:.2f} us of the stream, accepted: a longer --kernel-us",
            fixed_us);
        std::exit(1);
    }
    return static_cast<unsigned>(std::lround(iterations));
}

double period_us(const SpinGpu& gpu, CUstream stream, unsigned iterations) {
    constexpr int kLaunches = 3000;
    for (int i = 0; i < 100; ++i) gpu.launch(iterations, stream);
    MUST(cuStreamSynchronize(stream));
    const auto begin = std::chrono::steady_clock::now();
    for (int i = 0; i < kLaunches; ++i) gpu.launch(iterations, stream);
    MUST(cuStreamSynchronize(stream));
    const std::chrono::duration<double, std::micro> time = std::chrono::steady_clock::now() - begin;
    return time.count() / kLaunches;
}

Pace measure_pace(const SpinGpu& gpu, CUstream stream) {
    constexpr unsigned kFew = 20'000, kMany = 60'000;  // far longer than a launch
    const double few_us = period_us(gpu, stream, kFew), many_us = period_us(gpu, stream, kMany);
    const double us_per_iteration = (many_us - few_us) / static_cast<double>(kMany - kFew);
    if (us_per_iteration <= 1e-6) {
        tools::log_error(
            "kernels take the same time whatever they do; a simulated GPU? accepted then: "
            "--iterations");
        std::exit(1);
    }
    return {few_us - kFew * us_per_iteration, us_per_iteration};
}

}  // namespace urgengo::bench
