// SPDX-License-Identifier: Apache-2.0
//
// A stream on which tasks run, and the device memory that holds their results. Used by one thread
// at a time.
#pragma once

#include <span>

#include "tools/chains/gpu.h"
#include "tools/chains/stream_results.h"
#include "tools/chains/workload.h"

namespace urgengo::chains {

class TaskStream {
  public:
    /// @param gpu  current in the calling thread; outlives this
    explicit TaskStream(const Gpu& gpu);

    /// @param size  of the input, as in scaled_grid()
    void launch(std::span<const Kernel> kernels, double size = 1);
    void launch(const Kernel& kernel) { launch(std::span(&kernel, 1)); }
    void synchronize() const { stream_.synchronize(); }

    const Stream& stream() const { return stream_; }
    /// Blocks of all launches so far, modulo 2^32.
    unsigned blocks_launched() const { return blocks_launched_; }
    /// Waits for the stream, and copies what its kernels have left behind.
    StreamResults read_results() const;

  private:
    const Gpu& gpu_;
    Stream stream_;
    DeviceBuffer results_;
    unsigned blocks_launched_ = 0;
};

}  // namespace urgengo::chains
