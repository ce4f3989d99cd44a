// SPDX-License-Identifier: Apache-2.0
//
// A stream on which tasks run, and the device memory that holds their results. Used by one thread
// at a time.
#pragma once

#include <span>
#include <vector>

#include "tools/chains/gpu.h"
#include "tools/chains/stream_results.h"
#include "tools/chains/workload.h"

namespace urgengo::chains {

class TaskStream {
  public:
    /// @param gpu     current in the calling thread; outlives this
    /// @param stamps  launches that leave a stamp: the first so many; 0: none does
    explicit TaskStream(const Gpu& gpu, std::size_t stamps = 0);

    /// @param size  of the input, as in scaled_grid()
    void launch(std::span<const Kernel> kernels, double size = 1);
    void launch(const Kernel& kernel) { launch(std::span(&kernel, 1)); }
    void synchronize() const { stream_.synchronize(); }

    const Stream& stream() const { return stream_; }
    /// Blocks of all launches so far, modulo 2^32.
    unsigned blocks_launched() const { return blocks_launched_; }
    unsigned launches() const { return launches_; }
    /// Waits for the stream, and copies what its kernels have left behind.
    StreamResults read_results() const;
    /// Waits for the stream.
    /// @returns the stamps of the launches that have ended, less those beyond the room
    std::vector<LaunchStamp> read_stamps() const;

  private:
    const Gpu& gpu_;
    Stream stream_;
    DeviceBuffer results_, stamps_;
    CUdeviceptr results_word_;  // what the kernels get
    unsigned blocks_launched_ = 0;
    unsigned launches_ = 0;
};

}  // namespace urgengo::chains
