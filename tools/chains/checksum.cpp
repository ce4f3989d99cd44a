// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/checksum.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace urgengo::chains {

// Thread 0 of chains_comp: a fused multiply-add rounds once, here as on the GPU.
BlockValues::BlockValues(const Workload& workload) {
    int most = 0;
    for (const Chain& chain : workload.chains) {
        for (const Task& task : chain.tasks) {
            for (const Kernel& kernel : task.kernels) {
                if (kernel.kind == KernelKind::kCompute) most = std::max(most, kernel.iterations);
            }
        }
    }
    const float factor = 1.000001f;
    float a = 0, b = 1, c = 2, d = 3;
    compute_.reserve(static_cast<std::size_t>(most) + 1);
    compute_.push_back(std::bit_cast<std::uint32_t>(a + b + c + d));
    for (int i = 0; i < most; i++) {
        a = std::fmaf(a, factor, 1e-7f);
        b = std::fmaf(b, factor, 1e-7f);
        c = std::fmaf(c, factor, 1e-7f);
        d = std::fmaf(d, factor, 1e-7f);
        compute_.push_back(std::bit_cast<std::uint32_t>(a + b + c + d));
    }
}

std::uint32_t BlockValues::block_value(const Kernel& kernel) const {
    if (kernel.kind == KernelKind::kCompute) {
        return compute_[static_cast<std::size_t>(kernel.iterations)];
    }
    // Four sums of as many ones as iterations; exact in float up to 2^24.
    const float sum = static_cast<float>(kernel.iterations);
    return std::bit_cast<std::uint32_t>(sum + sum + sum + sum);
}

std::uint64_t BlockValues::task_sum(const Task& task, double size) const {
    std::uint64_t sum = 0;
    for (const Kernel& kernel : task.kernels) {
        const int blocks = scaled_grid(kernel, size);
        sum += std::uint64_t{block_value(kernel)} * static_cast<std::uint64_t>(blocks);
    }
    return sum;
}

}  // namespace urgengo::chains
