// SPDX-License-Identifier: Apache-2.0
//
// What a launch's config says, as cuLaunchKernelEx takes it.
#pragma once

#include <cuda.h>

#include <algorithm>
#include <cstdint>

#include "host/runtime/runtime.h"

namespace urgengo::interposer {

inline std::uint64_t grid_blocks(const CUlaunchConfig& c) {
    return std::uint64_t{c.gridDimX} * c.gridDimY * c.gridDimZ;
}
inline unsigned block_threads(const CUlaunchConfig& c) {
    return c.blockDimX * c.blockDimY * c.blockDimZ;
}

/// Of a grid whose blocks must all be on the GPU at once.
inline bool is_cooperative(const CUlaunchConfig& c) {
    return std::any_of(c.attrs, c.attrs + c.numAttrs, [](const CUlaunchAttribute& a) {
        return a.id == CU_LAUNCH_ATTRIBUTE_COOPERATIVE && a.value.cooperative != 0;
    });
}

/// @returns the launch that the runtime is asked about
runtime::Launch described(const CUlaunchConfig& config, CUfunction f, exec::StreamFlavor flavor);

}  // namespace urgengo::interposer
