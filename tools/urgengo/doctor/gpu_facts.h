// SPDX-License-Identifier: Apache-2.0
//
// What the driver says of its GPUs, and what the first of them can do.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "host/base/result.h"

namespace urgengo::cli {

struct GpuDevice {
    std::string name;
    int compute_major = 0;
    int compute_minor = 0;
    int num_sms = 0;
    std::int64_t memory_mib = 0;
    int compute_mode = 0;  ///< CU_COMPUTEMODE_*
};

struct GpuFacts {
    int cuda_version = 0;            ///< that the driver is for: 13000
    std::vector<GpuDevice> devices;  ///< that the program would find
    std::string context_problem;     ///< why there is no context on the first; empty: there is
    // The rest only with a context.
    int least_priority = 0;
    int greatest_priority = 0;
    std::string memory_operation_problem;  ///< of writing and waiting in a stream; empty: they work
};

/// Asks in a child.
/// @param library  empty: libcuda.so.1, as the loader finds it
/// @errors why there are none: one line
Result<GpuFacts> find_gpu_facts(const std::string& library, std::chrono::milliseconds limit);

}  // namespace urgengo::cli
