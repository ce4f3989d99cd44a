// SPDX-License-Identifier: Apache-2.0
//
// Kernels that fill the first GPU for as long as they are told: on the simulated one by a cost
// table, on a real one by a spin kernel whose pace is measured once.
#pragma once

#include <cuda.h>

#include <string>

namespace urgengo::bench {

/// Ends the program, with a line on stderr, unless the call succeeded.
#define MIX_MUST(call) ::urgengo::bench::mix_must((call), #call)
void mix_must(CUresult result, const char* call);

class MixGpu {
  public:
    /// The context is the calling thread's from then on.
    MixGpu();

    void make_current() const { MIX_MUST(cuCtxSetCurrent(context_)); }
    CUstream make_stream() const;
    CUevent make_event() const;
    /// @param which  a number: chains have kernels of different names where the GPU is simulated
    void launch(int which, unsigned kernel_us, CUstream stream) const;
    std::string name() const;

  private:
    bool load_simulated();
    void load_real();
    double measure_us(unsigned units) const;

    static constexpr int kKernels = 8;
    CUdevice device_ = 0;
    CUcontext context_ = nullptr;
    CUfunction kernels_[kKernels] = {};
    unsigned blocks_ = 1, threads_ = 1024;
    double units_per_us_ = 1;
};

}  // namespace urgengo::bench
