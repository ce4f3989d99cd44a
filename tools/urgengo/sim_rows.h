// SPDX-License-Identifier: Apache-2.0
//
// The rows of `urgengo sim`: bare, and presets with changes, as `bench smoke` names them. Pure.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "tools/sim/subject.h"
#include "tools/urgengo/sim_workload.h"

namespace urgengo::cli {

/// `--rows all`: bare and every preset.
inline constexpr char kAllRows[] = "all";

/// @returns the rows that are meant
std::vector<std::string> expand_rows(const std::vector<std::string>& rows);

/// @returns what is wrong with the row's name, or what the simulator lacks for it; empty: nothing
std::string check_sim_row(const std::string& name);

/// @param name       checked; its preset and changes go over the scheduler of a recorded program
/// @param workload   at the scenario's load
/// @param seed       of the noise of its profile, if it has any
/// @param mark_late  from a mark's end on the GPU to when the host sees it
std::unique_ptr<sim::Subject> make_sim_row(const std::string& name, const SimWorkload& workload,
                                           const chains::Scenario& scenario, std::uint32_t seed,
                                           std::chrono::nanoseconds mark_late);

}  // namespace urgengo::cli
