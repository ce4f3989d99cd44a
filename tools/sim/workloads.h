// SPDX-License-Identifier: Apache-2.0
//
// What the simulated chains launch: the ten chains as an H200 was calibrated to, or any
// workload.json. Pure.
#pragma once

#include "tools/chains/workload.h"
#include "tools/sim/gpu_model.h"

namespace urgengo::sim {

/// The paper's ten chains with the kernels of the published measurements (seed 7). A kernel takes
/// what its blocks take (GpuShape), times the factor by which each chain takes as long as on the
/// H200 alone.
/// @source  tools/bench/results/2026-11-21_h200_profiles.json, calibrated_gpu_ms
chains::Workload h200_ten_chains();

/// @param size  of the frame's input, 1 for the middle of its range
/// @returns the kernel's blocks, of which those of size 1 take what it was measured to take alone,
///          with the gap before it
KernelWork work_of(const chains::Kernel& kernel, const GpuShape& shape, double size = 1);

}  // namespace urgengo::sim
