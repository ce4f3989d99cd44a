// SPDX-License-Identifier: Apache-2.0
//
// The last completed kernels, for tests (simgpu.h). Written by the engine's thread, read by any.
#pragma once

#include <cstddef>
#include <deque>
#include <mutex>

#include "tools/simgpu/engine/engine.h"
#include "tools/simgpu/simgpu.h"

namespace urgengo::simgpu {

class KernelLog {
  public:
    static constexpr std::size_t kMaxRecords = 65536;

    void add(const KernelRecord& record);
    /// @returns how many there are; copies the oldest `max` of them to `out`
    std::size_t read(simgpu_kernel_record* out, std::size_t max) const;
    void clear();

  private:
    mutable std::mutex mutex_;
    std::deque<simgpu_kernel_record> records_;
};

}  // namespace urgengo::simgpu
