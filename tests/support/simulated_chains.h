// SPDX-License-Identifier: Apache-2.0
//
// Chains of a few numbers each, governed by the real Governor in the simulator (tools/sim).
#pragma once

#include <chrono>
#include <vector>

#include "host/config/config.h"

namespace urgengo::testing {

using std::chrono::nanoseconds;

struct SimulatedTask {
    nanoseconds cpu{0};           ///< before its GPU work
    nanoseconds gpu{0};           ///< of all its kernels, alone
    nanoseconds kernel{100'000};  ///< of each
    double utilization = 1;       ///< share of the GPU that each fills
};

struct SimulatedChain {
    nanoseconds period{0}, deadline{0}, phase{0};
    std::vector<SimulatedTask> tasks;
    int criticality = 1;
    config::OnLate on_late = config::OnLate::kContinue;
    bool is_dead = false;  ///< its GPU work waits for something that never happens
};

struct SimulatedOutcome {
    int instances = 0;  ///< that ended, or should have
    int missed = 0;
    nanoseconds longest_hold{0};  ///< of any instance, in all
    double miss_ratio() const { return instances > 0 ? double(missed) / instances : 0; }
};

struct SimulatedSettings {
    config::Scheduler scheduler = without_guard();
    nanoseconds duration{5'000'000'000};

  private:
    static config::Scheduler without_guard() {
        config::Scheduler scheduler;
        scheduler.guard = false;
        return scheduler;
    }
};

/// @returns what became of each chain
std::vector<SimulatedOutcome> simulate(const std::vector<SimulatedChain>& chains,
                                       const SimulatedSettings& settings);

/// @returns the mean of the chains' miss ratios
double mean_miss_ratio(const std::vector<SimulatedOutcome>& outcomes);

}  // namespace urgengo::testing
