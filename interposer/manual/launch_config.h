// SPDX-License-Identifier: Apache-2.0
//
// What a launch's config says, as cuLaunchKernelEx takes it.
#pragma once

#include <cuda.h>

#include <cstdint>

#include "host/runtime/runtime.h"

namespace urgengo::interposer {

inline std::uint64_t grid_blocks(const CUlaunchConfig& c) {
    return std::uint64_t{c.gridDimX} * c.gridDimY * c.gridDimZ;
}
inline unsigned block_threads(const CUlaunchConfig& c) {
    return c.blockDimX * c.blockDimY * c.blockDimZ;
}

/// @returns the launch that the runtime is asked about
runtime::Launch described(const CUlaunchConfig& config, CUfunction f, exec::StreamFlavor flavor);

}  // namespace urgengo::interposer
