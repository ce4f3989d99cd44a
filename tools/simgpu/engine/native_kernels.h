// SPDX-License-Identifier: Apache-2.0
//
// Kernels that do something: recognised by name, executed on the host when they complete. All other
// kernels only take their time. To add one: a line in the table in native_kernels.cpp.
#pragma once

#include <cstddef>
#include <span>
#include <string_view>

#include "tools/simgpu/engine/part.h"

namespace urgengo::simgpu {

struct NativeKernel {
    std::string_view name;
    std::span<const std::size_t> param_bytes;  ///< the size of each parameter
    Time block_time;                           ///< before the time scale
    /// @param[in] params  the parameters as laid out by layout_params()
    /// @param[in] end     the kernel's nominal end
    void (*run)(std::span<const std::byte> params, Time end);
    /// Besides, for each of what the first parameter says, before the time scale.
    double block_ns_per_unit = 0;
};

/// @returns null if the kernel of that name is not native
const NativeKernel* find_native_kernel(std::string_view name);

}  // namespace urgengo::simgpu
