// SPDX-License-Identifier: Apache-2.0
//
// How hard the workload is pressed: the paper's factors on arrival rates and deadlines.
#pragma once

#include <chrono>
#include <limits>
#include <string>
#include <vector>

#include "tools/chains/workload.h"

namespace urgengo::chains {

struct Scenario {
    double f_a = 1.0;                ///< on arrival rates
    double f_d = 1.0;                ///< on deadlines
    std::vector<std::string> tight;  ///< chains whose deadline is halved
    bool deadlines = true;           ///< whether there are any: else nothing is late

    bool is_tight(const Chain& chain) const;
    double period_ms(const Chain& chain) const { return chain.period_ms / f_a; }
    /// Infinite without deadlines.
    double deadline_ms(const Chain& chain) const {
        if (!deadlines) return std::numeric_limits<double>::infinity();
        return chain.deadline_ms * f_d * (is_tight(chain) ? 0.5 : 1.0);
    }
};

/// @throws std::runtime_error when a tight chain is not in the workload
void check_scenario(const Scenario& scenario, const Workload& workload);

/// Whether a chain has one thread for all its tasks, or one for each.
enum class Threads { kPerChain, kPerTask };

/// @returns the name of the thread that runs the task, at most 15 bytes: C0, or C0.detect3d
std::string thread_name(Threads threads, const Chain& chain, const Task& task);

}  // namespace urgengo::chains
