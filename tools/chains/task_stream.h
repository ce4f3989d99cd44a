// SPDX-License-Identifier: Apache-2.0
//
// A stream on which tasks run, and the device memory that holds their results. Used by one thread
// at a time.
#pragma once

#include "tools/chains/gpu.h"
#include "tools/chains/stream_results.h"
#include "tools/chains/workload.h"

namespace urgengo::chains {

class TaskStream {
  public:
    /// @param gpu  current in the calling thread; outlives this
    explicit TaskStream(const Gpu& gpu);

    void launch(const Kernel& kernel);
    void launch(const Task& task);
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
