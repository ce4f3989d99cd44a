// SPDX-License-Identifier: Apache-2.0
//
// Whether this machine has a GPU that the driver can use, and which.
#pragma once

#include <cstdint>
#include <string>

namespace urgengo::cli {

struct GpuProbe {
    bool found = false;
    std::string name{};              ///< of the first device
    std::string problem{};           ///< why none was found
    std::string driver{};            ///< the CUDA that it is for: "13.0"
    std::uint32_t sm_clock_mhz = 0;  ///< peak, as is the next; 0: not known
    std::uint32_t memory_clock_mhz = 0;
};

/// Asks the driver in a child (driver_question.h). Waits at most 30 s.
/// It sees what the program would see: CUDA_VISIBLE_DEVICES holds for it too.
/// @param library  empty: libcuda.so.1, as the loader finds it
GpuProbe probe_gpu(const std::string& library);

}  // namespace urgengo::cli
