// SPDX-License-Identifier: Apache-2.0
//
// A program that UrgenGo knows by a chains.yaml and a recorded profile, as a workload: each chain a
// thread that launches what the profile says, as fast as it says, and waits. Pure.
//
//  1 A kernel takes its time of the GPU alone, with its grid (workloads.h). How many of its blocks
//  a
//    multiprocessor holds follows from its utilisation, where registers or shared memory bound
//    that: blocks over the blocks that the GPU holds (host/identity/occupied_share.cpp). Its launch
//    takes its thread the time since the one before, as the profile has it (launch_ns).
//  2 A profile says which stream a launch is on, not who waits for whom: a task that leaves its
//    first stream is taken to fork there, and to join all others when it comes back, or ends, as
//    libraries do that fork by themselves.
//  3 Frames come as to the programs of tools/bench/programs (frames.py): at a phase of the period,
//    each up to a tenth of a period late; of more than two that wait, the oldest are left out.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "host/base/result.h"
#include "host/config/config.h"
#include "tools/chains/arrivals.h"
#include "tools/chains/workload.h"
#include "tools/sim/chain_model.h"

namespace urgengo::sim {

struct RecordedProgram {
    config::Config config;
    config::Profile profile;  ///< of the config's chains and tasks, in their order
    chains::Workload workload;
    std::vector<ChainTraits> traits;
};

/// @errors the first chain or task that the profile lacks, or that is not simulated: one with
///         several waits, with none, or with graphs
Result<RecordedProgram> recorded(const config::Config& config, const config::Profile& profile);

/// What a run says of a chain, by its name.
struct ChainTimes {
    std::string name;
    double period_ms = 0, deadline_ms = 0;
    double pace = 1;  ///< what its launching took, over what the profile says
};
/// Sets periods and deadlines in both, and how fast the program launches.
/// @returns the first chain that `times` lacks; empty: none
std::string set_times(RecordedProgram& program, const std::vector<ChainTimes>& times);

/// @returns by chain, as WorldSettings::frames
std::vector<std::vector<chains::PlannedFrame>> recorded_frames(const chains::Workload& workload,
                                                               const chains::Scenario& scenario,
                                                               double seconds, std::uint32_t seed);

}  // namespace urgengo::sim
