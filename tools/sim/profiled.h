// SPDX-License-Identifier: Apache-2.0
//
// What a user gives UrgenGo for a workload: the chains as tools/chains/chains.yaml has them, and
// the profile that `urgengo profile` learns, here without an error. Pure.
#pragma once

#include <vector>

#include "host/config/config.h"
#include "tools/chains/scenario.h"
#include "tools/chains/workload.h"
#include "tools/sim/chain_model.h"

namespace urgengo::sim {

/// Of a multiprocessor's warps, that keep it busy: as host/identity/occupied_share.cpp reckons.
inline constexpr double kBusyShareOfWarps = 0.5;

/// @param scenario  multiplies periods and deadlines
config::Config configured(const chains::Workload& workload, const chains::Scenario& scenario,
                          const config::Scheduler& scheduler);

/// Kernels take their time alone, without the gap before it; a segment takes the gaps as well. Of a
/// task over several streams each says what it adds to the time that the GPU is busy.
/// @param traits  of the chains, in their order; of the last ones none need be given
config::Profile profiled(const chains::Workload& workload,
                         const std::vector<ChainTraits>& traits = {});

}  // namespace urgengo::sim
