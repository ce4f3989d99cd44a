// SPDX-License-Identifier: Apache-2.0
//
// The driver's start: in a run of `urgengo profile` CUPTI starts right after it, before there is
// any context.
#include "interposer/kernel_times.h"
#include "interposer/real_driver.h"

extern "C" CUresult CUDAAPI cuInit(unsigned flags) {
    using namespace urgengo::interposer;
    const CUresult result = real().cuInit(flags);
    if (result == CUDA_SUCCESS) start_kernel_times();
    return result;
}
