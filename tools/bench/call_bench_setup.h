// SPDX-License-Identifier: Apache-2.0
//
// What the call benchmark and its config agree on: the names of chains and threads, and how much
// GPU time everybody's kernels are said to take.
#pragma once

#include <string>

namespace urgengo::bench {

/// The chain whose launches are timed: found by this hint, or by this name of the thread.
inline constexpr char kMeasured[] = "measured";
inline constexpr char kMeasuredThread[] = "ug_measured";
/// Of no chain.
inline constexpr char kNobodysThread[] = "ug_nobody";
inline constexpr char kKernel[] = "bench_kernel";
/// Launches between two synchronisations: a frame.
inline constexpr int kFrameLaunches = 200;

/// Another chain, less urgent, that has work on the GPU throughout. Also its thread's name.
inline std::string other_chain(int index) {
    return "ug_other_" + std::to_string(index);
}

/// Writes a resolved config with `num_chains` chains, and a profile that knows every kernel.
/// @param mark_every_us  GPU time between two marks; a measured kernel counts as 3 us
/// @param kernel_us      what a measured kernel counts as
/// @returns what is wrong; empty if nothing is
std::string write_config(const std::string& path, int num_chains, int mark_every_us,
                         double kernel_us);

}  // namespace urgengo::bench
