// SPDX-License-Identifier: Apache-2.0
//
// What the tests of the simulated driver share: a context to work in, a function of known cost, the
// kernel log. They judge nominal times from the log, never how long the test itself takes.
#pragma once

#include <cuda.h>

#include <cstdint>
#include <string>
#include <vector>

#include "tests/support/catch.h"
#include "tools/simgpu/simgpu.h"

/// The primary context, current for the test's duration, and a module with kernels of known cost:
/// "unit" takes as many nanoseconds a block as its first parameter (uint32) says and fits once on
/// an SM; "short" takes 10 us.
class SimGpu {
  public:
    SimGpu() {
        REQUIRE(cuInit(0) == CUDA_SUCCESS);
        REQUIRE(cuDevicePrimaryCtxRetain(&context, 0) == CUDA_SUCCESS);
        REQUIRE(cuCtxSetCurrent(context) == CUDA_SUCCESS);
        REQUIRE(cuModuleLoadData(&module, R"( {"kernels":[
            {"name":"unit","block_ns_per_unit":1,"unit_arg":0,"unit_bytes":4,"blocks_per_sm":1},
            {"name":"second","block_ns_per_unit":1,"unit_arg":1,"unit_bytes":8,"param_bytes":[4,8]},
            {"name":"short","block_ns":10000}]})") == CUDA_SUCCESS);
        simgpu_kernel_log_clear();
    }
    ~SimGpu() {
        cuDevicePrimaryCtxRelease(0);
        cuCtxSetCurrent(nullptr);
    }
    SimGpu(const SimGpu&) = delete;
    SimGpu& operator=(const SimGpu&) = delete;

    CUfunction function(const char* name) const {
        CUfunction f = nullptr;
        REQUIRE(cuModuleGetFunction(&f, module, name) == CUDA_SUCCESS);
        return f;
    }

    CUstream stream(unsigned flags = CU_STREAM_NON_BLOCKING, int priority = 0) const {
        CUstream s = nullptr;
        REQUIRE(cuStreamCreateWithPriority(&s, flags, priority) == CUDA_SUCCESS);
        return s;
    }

    /// Launches "unit": `blocks` blocks of `ns` each.
    CUresult launch(CUstream s, unsigned ns, unsigned blocks = 1) const {
        void* params[] = {&ns};
        return cuLaunchKernel(function("unit"), blocks, 1, 1, 32, 1, 1, 0, s, params, nullptr);
    }

    CUcontext context = nullptr;
    CUmodule module = nullptr;
};

/// Holds streams until it is opened, so that what is queued behind it is queued for certain,
/// however slow the machine that runs the test.
class Gate {
  public:
    Gate() {
        REQUIRE(cuMemHostAlloc(reinterpret_cast<void**>(&word_), sizeof *word_, 0) == CUDA_SUCCESS);
    }
    ~Gate() {
        open();
        cuMemFreeHost(word_);
    }
    Gate(const Gate&) = delete;
    Gate& operator=(const Gate&) = delete;

    void hold(CUstream stream) {
        REQUIRE(cuStreamWaitValue32(stream, reinterpret_cast<CUdeviceptr>(word_), 1,
                                    CU_STREAM_WAIT_VALUE_EQ) == CUDA_SUCCESS);
    }
    void open() { __atomic_store_n(word_, 1, __ATOMIC_RELEASE); }

  private:
    std::uint32_t* word_ = nullptr;
};

inline std::vector<simgpu_kernel_record> kernel_log() {
    std::vector<simgpu_kernel_record> records(simgpu_kernel_log(nullptr, 0));
    simgpu_kernel_log(records.data(), records.size());
    return records;
}

inline unsigned long long id_of(CUstream stream) {
    unsigned long long id = 0;
    REQUIRE(cuStreamGetId(stream, &id) == CUDA_SUCCESS);
    return id;
}
