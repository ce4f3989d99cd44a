// SPDX-License-Identifier: Apache-2.0
//
// What a user gives UrgenGo for a workload: the chains as tools/chains/chains.yaml has them, and
// the profile that `urgengo profile` learns, here without an error. Pure.
#pragma once

#include <vector>

#include "host/config/config.h"
#include "tools/chains/scenario.h"
#include "tools/chains/workload.h"
#include "tools/sim/gpu_model.h"

namespace urgengo::sim {

/// @param scenario  multiplies periods and deadlines
std::vector<config::Chain> configured(const chains::Workload& workload,
                                      const chains::Scenario& scenario);

/// Kernels take their time alone, without the gap before it; a segment takes the gaps as well.
/// @param launch  that a launch takes of its thread
config::TaskProfile profiled(const chains::Task& task, const GpuShape& shape, nanoseconds launch);

}  // namespace urgengo::sim
