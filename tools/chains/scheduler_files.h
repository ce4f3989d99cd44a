// SPDX-License-Identifier: Apache-2.0
//
// The two files that UrgenGo needs to schedule the workload: its configuration and a profile. Pure.
#pragma once

#include <string>

#include "tools/chains/scenario.h"
#include "tools/chains/workload.h"

namespace urgengo::chains {

enum class OnLate { kExit, kContinue };

/// @returns chains.yaml; thread names are those of `run` with the same `threads`
std::string format_yaml(const Workload& workload, const Scenario& scenario, OnLate on_late,
                        Threads threads);

/// @returns chains.profile.json
std::string format_profile(const Workload& workload);

}  // namespace urgengo::chains
