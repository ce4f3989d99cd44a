// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/task_stream.h"

#include <algorithm>

namespace urgengo::chains {

TaskStream::TaskStream(const Gpu& gpu, std::size_t stamps)
    : gpu_(gpu), results_(sizeof(StreamResults)), results_word_(results_.get()) {
    CHAINS_CUDA(cuMemsetD8(results_.get(), 0, sizeof(StreamResults)));
    if (stamps > 0) {
        stamps_ = DeviceBuffer(stamps * sizeof(LaunchStamp));
        CHAINS_CUDA(cuMemsetD8(stamps_.get(), 0xff, stamps * sizeof(LaunchStamp)));
        const LaunchStamps empty{reinterpret_cast<LaunchStamp*>(stamps_.get()),
                                 static_cast<unsigned>(stamps), 0};
        CHAINS_CUDA(cuMemcpyHtoD(results_.get(), &empty, sizeof(empty)));
        results_word_ += kWithStamps;
    }
    // The memset may be asynchronous, and a non-blocking stream would not wait for it.
    CHAINS_CUDA(cuCtxSynchronize());
}

void TaskStream::launch(std::span<const Kernel> kernels, double size) {
    for (const Kernel& kernel : kernels) {
        const int grid = scaled_grid(kernel, size);
        gpu_.launch(kernel, grid, stream_.get(), results_word_, blocks_launched_);
        blocks_launched_ += static_cast<unsigned>(grid);
        ++launches_;
    }
}

StreamResults TaskStream::read_results() const {
    synchronize();
    StreamResults results{};
    CHAINS_CUDA(cuMemcpyDtoH(&results, results_.get(), sizeof(results)));
    return results;
}

std::vector<LaunchStamp> TaskStream::read_stamps() const {
    const LaunchStamps written = read_results().stamps;
    std::vector<LaunchStamp> stamps(std::min(written.launches, written.room));
    if (!stamps.empty()) {
        CHAINS_CUDA(
            cuMemcpyDtoH(stamps.data(), stamps_.get(), stamps.size() * sizeof(LaunchStamp)));
    }
    return stamps;
}

}  // namespace urgengo::chains
