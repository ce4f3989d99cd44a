// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/task_stream.h"

namespace urgengo::chains {

TaskStream::TaskStream(const Gpu& gpu) : gpu_(gpu), results_(sizeof(StreamResults)) {
    CHAINS_CUDA(cuMemsetD8(results_.get(), 0, sizeof(StreamResults)));
    // The memset may be asynchronous, and a non-blocking stream would not wait for it.
    CHAINS_CUDA(cuCtxSynchronize());
}

void TaskStream::launch(std::span<const Kernel> kernels, double size) {
    for (const Kernel& kernel : kernels) {
        const int grid = scaled_grid(kernel, size);
        gpu_.launch(kernel, grid, stream_.get(), results_.get(), blocks_launched_);
        blocks_launched_ += static_cast<unsigned>(grid);
    }
}

StreamResults TaskStream::read_results() const {
    synchronize();
    StreamResults results{};
    CHAINS_CUDA(cuMemcpyDtoH(&results, results_.get(), sizeof(results)));
    return results;
}

}  // namespace urgengo::chains
