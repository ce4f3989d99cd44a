// SPDX-License-Identifier: Apache-2.0
//
// workload.json: the chains as calibrated for one GPU. `calibrate` writes it, `run` reads it.
// Plain data that mirrors the file; reading checks every value.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace urgengo::chains {

inline constexpr int kWorkloadFormatVersion = 2;

enum class KernelKind { kCompute, kMemory };

/// @returns the kernel's name in the module, in workload.json and in profiles
const char* kernel_name(KernelKind kind);

struct Kernel {
    KernelKind kind = KernelKind::kCompute;
    int grid = 1;            ///< blocks
    int block = 1;           ///< threads
    int iterations = 1;      ///< the kernel's first parameter
    double est_us = 0;       ///< measured alone; they add up to the task's isolated time
    double utilization = 0;  ///< share of the GPU's block slots (at 4 a multiprocessor) in one wave
};

struct Task {
    std::string name;
    double cpu_ms = 0;       ///< mean CPU segment before the first launch
    double isolated_ms = 0;  ///< measured GPU time, alone
    /// Size of a frame's input: uniform in this range where inputs vary, else its middle, for which
    /// the kernels' grids are.
    int min_inputs = 1, max_inputs = 1;
    std::vector<Kernel> kernels;
};

struct Chain {
    std::string name;
    double period_ms = 0;
    double deadline_ms = 0;  ///< before any tightening
    std::vector<Task> tasks;
    std::string copy_of{};  ///< the chain that this is a copy of (copies.h); empty: none
    /// In the file, or among copies. It gives the chain random numbers of its own, the same ones
    /// whichever other chains run.
    std::size_t place = 0;
};

struct Workload {
    std::string gpu;
    std::string driver;
    int num_sms = 0;
    std::uint32_t seed = 0;
    double umin = 0, umax = 0;
    double gpu_scale = 1;
    double memory_share = 0;
    bool variable = false;  ///< whether the size of inputs varies from frame to frame
    std::vector<Chain> chains;
};

/// @param size  of the input, 1 for the middle of its range
/// @returns the blocks that the kernel is launched with; at least one
int scaled_grid(const Kernel& kernel, double size);

/// @throws std::runtime_error naming the place, what was found and what is accepted
Workload parse_workload(const std::string& json_text);

std::string format_workload(const Workload& workload);

}  // namespace urgengo::chains
