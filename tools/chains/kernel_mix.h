// SPDX-License-Identifier: Apache-2.0
//
// Turns a task of the paper (so many kernels, so many milliseconds) into a list of kernels that
// fits a GPU. Pure: the same arguments give the same list.
#pragma once

#include <cstdint>

#include "tools/chains/spec.h"
#include "tools/chains/workload.h"

namespace urgengo::chains {

/// Blocks that a multiprocessor is taken to hold: a kernel's utilisation is its blocks per wave
/// over this many on every multiprocessor.
inline constexpr int kBlocksPerSm = 4;
inline constexpr int kBlockThreads = 256;

struct MixSettings {
    std::uint32_t seed = 7;  ///< the default gives the mix of the published measurements
    double umin = 0.3, umax = 1.0;
    double gpu_scale = 1.0;     ///< on every task's GPU time
    double memory_share = 0.0;  ///< of kernels that stream memory instead of computing
};

/// Time of one iteration on a GPU with kBlocksPerSm blocks on every multiprocessor.
struct IterationCost {
    double compute_us = 0;
    double memory_us = 0;
};

/// @returns the seed of task `task` of chain `chain` (indices into paper_chains())
std::uint32_t task_seed(std::uint32_t seed, std::size_t chain, std::size_t task);

/// Kernel times are spread log-normally (sigma 0.8), at least 4 us each; longer kernels have
/// several waves of blocks of about 60 us; each wave fills a uniform umin..umax of the block slots.
Task build_task(const TaskSpec& spec, double cpu_ms, std::uint32_t seed,
                const MixSettings& settings, const IterationCost& cost, int num_sms);

/// Multiplies the iterations of every kernel, each at least one.
void scale_iterations(Task& task, double factor);

/// Spreads a measured time over the kernels in proportion to their estimates.
void set_isolated_ms(Task& task, double measured_ms);

}  // namespace urgengo::chains
