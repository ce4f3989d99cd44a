// SPDX-License-Identifier: Apache-2.0
//
// The ten-chain workload as a program of the whole runtime, in lockstep (lockstep.h): every launch
// goes the way that it takes in the interposer, and what became of it is hashed.
#pragma once

#include <cstdint>
#include <string>

#include "host/config/config.h"

namespace urgengo::testing {

struct LockstepScenario {
    std::string name{};
    config::Scheduler scheduler{};
    double f_a = 1;  ///< on arrival rates
    double f_d = 1;  ///< on deadlines
    std::chrono::nanoseconds duration{1'000'000'000};
    std::uint32_t seed = 4;
    bool has_profile = true;
    bool forks = false;         ///< all tasks, over four streams, joined at the end
    bool locks = false;         ///< C0, C2 and C4 launch under one lock
    bool bystander = false;     ///< a thread of no chain launches 1 ms of kernels every 4 ms
    bool launch_bound = false;  ///< every other chain launches more slowly than the GPU executes
    std::string log_path{};     ///< not empty: a line for every launch and mark is written there
};

struct LockstepOutcome {
    std::uint64_t launches = 0, marks = 0, frames = 0, missed = 0, held_us = 0;
    /// Of time, task, position, priority and wait of every launch, and of every mark's time,
    /// stream and word.
    std::uint64_t hash = 0;

    bool operator==(const LockstepOutcome&) const = default;
};

LockstepOutcome run_lockstep(const LockstepScenario& scenario);

}  // namespace urgengo::testing
