// SPDX-License-Identifier: Apache-2.0
//
// The first GPU, and a kernel on it that takes as long as it is told: one block of one warp.
#pragma once

#include <cuda.h>

#include <string>

namespace urgengo::bench {

/// Ends the program, with a line on stderr, unless the call succeeded.
#define MUST(call) ::urgengo::bench::must((call), #call)
void must(CUresult result, const char* call);

class SpinGpu {
  public:
    /// The context is the calling thread's from then on.
    SpinGpu();

    /// For a thread that has none.
    void make_current() const { MUST(cuCtxSetCurrent(context_)); }
    CUstream make_stream() const;
    void launch(unsigned iterations, CUstream stream) const;
    std::string name() const;

  private:
    CUdevice device_ = 0;
    CUcontext context_ = nullptr;
    CUfunction kernel_ = nullptr;
};

/// How long the kernel takes.
struct Pace {
    double fixed_us = 0, us_per_iteration = 0;

    /// @param period_us  from one kernel's start to the next one's, in a long chain
    /// @errors ends the program, with a line on stderr, if no number of iterations makes that
    unsigned iterations(double period_us) const;
};

/// @returns the time from one kernel's start to the next one's in a long chain, microseconds
double period_us(const SpinGpu& gpu, CUstream stream, unsigned iterations);

/// @errors ends the program, with a line on stderr, where iterations take no time
Pace measure_pace(const SpinGpu& gpu, CUstream stream);

}  // namespace urgengo::bench
