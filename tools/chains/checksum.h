// SPDX-License-Identifier: Apache-2.0
//
// What the kernels must have left behind: their arithmetic again, on the CPU, bit for bit.
#pragma once

#include <cstdint>
#include <vector>

#include "tools/chains/workload.h"

namespace urgengo::chains {

/// Knows the value that each block of a kernel adds to its stream's sum.
class BlockValues {
  public:
    /// @param workload  whose iteration counts must be known
    explicit BlockValues(const Workload& workload);

    /// @param size  of the task's input, as in scaled_grid()
    /// @returns what all blocks of all the task's kernels add, modulo 2^64
    std::uint64_t task_sum(const Task& task, double size) const;

  private:
    std::uint32_t block_value(const Kernel& kernel) const;

    std::vector<std::uint32_t> compute_;  ///< by number of iterations
};

}  // namespace urgengo::chains
