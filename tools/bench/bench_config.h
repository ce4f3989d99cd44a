// SPDX-License-Identifier: Apache-2.0
//
// What the benchmark programs and their config agree on: the names of chains, threads and kernel,
// and how much GPU time the kernels of each are said to take.
#pragma once

#include <string>
#include <vector>

#include "host/config/config.h"

namespace urgengo::bench {

/// The chain whose launches are timed: found by this hint, or by this name of the thread.
inline constexpr char kMeasured[] = "measured";
inline constexpr char kMeasuredThread[] = "ug_measured";
/// The bystander: of no chain.
inline constexpr char kBystanderThread[] = "ug_nobody";
inline constexpr char kKernel[] = "bench_kernel";
/// One block of 32 threads of it is a launch.
inline constexpr unsigned kKernelThreads = 32;

/// Another chain, less urgent. Also its thread's name.
inline std::string other_chain(int index) {
    return "ug_other_" + std::to_string(index);
}

/// The chain whose frames `urgengo bench tracking` compares with a bystander's. Also its thread's
/// name.
inline std::string cell_chain(int index) {
    return "ug_cell_" + std::to_string(index);
}
/// Where such a chain is on the GPU: alone, or beside another chain.
inline constexpr char kAlone[] = "alone", kBeside[] = "beside";

struct MeasuredChain {
    std::string name, thread;
    double kernel_us = 3;  ///< what a launch counts as
    int frame_launches = 200;
};

struct ConfigSpec {
    std::vector<MeasuredChain> measured;
    int num_others = 0;
    config::Scheduler scheduler;
};

/// Writes a resolved config, and a profile that knows every launch.
/// @returns what is wrong; empty if nothing is
std::string write_config(const std::string& path, const ConfigSpec& spec);

}  // namespace urgengo::bench
