// SPDX-License-Identifier: Apache-2.0
//
// The paper's workload in numbers: chains C0 to C9 and which of them have tight deadlines.
#pragma once

#include <string>
#include <vector>

namespace urgengo::chains {

struct TaskSpec {
    std::string name;
    int num_kernels;
    double gpu_ms;  ///< alone on the paper's GPU
    /// Size of a frame's input (N_s in the paper): points, particles, map cells. A task whose input
    /// has one size, such as an image, has 1.
    int min_inputs = 1, max_inputs = 1;
};

struct ChainSpec {
    std::string name;
    double period_ms;
    double deadline_ms;  ///< from the frame's arrival, before tightening
    double cpu_ms;       ///< of the whole chain; every task has an equal share
    std::vector<TaskSpec> tasks;
};

const std::vector<ChainSpec>& paper_chains();

/// Arrivals are late by a uniform 0..kJitterMs (paper, section "Task Chain Setup").
inline constexpr double kJitterMs = 15;

/// The chains whose deadline is halved.
/// @param fraction  of all chains, 0..1, rounded to a whole number of chains (f_tight in the paper)
/// @returns names in the order in which chains are tightened: C0 C3 C6 C8 (0.4), then C1 C2 C4 C5
///          C7 C9. The paper does not name them; C9, whose GPU time alone is 46 ms, comes last.
std::vector<std::string> tight_chains(double fraction);

}  // namespace urgengo::chains
