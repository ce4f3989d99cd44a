// SPDX-License-Identifier: Apache-2.0
//
// Task chains on one GPU in virtual time, decided upon by host/sched: threads that compute, launch
// kernels, are held and wait, a quarter of a tenth of a millisecond at a time. What is on the GPU
// at once shares it by utilisation, as kernels do that issue as fast as they can.
#pragma once

#include <vector>

#include "host/config/config.h"
#include "host/sched/snapshot.h"

namespace urgengo::testing {

using std::chrono::nanoseconds;

/// A thread that is held looks again this often.
inline constexpr nanoseconds kVirtualStep{25'000};

struct VirtualTask {
    nanoseconds cpu{0};           ///< before its GPU work
    nanoseconds gpu{0};           ///< of all its kernels, alone
    nanoseconds kernel{100'000};  ///< of each
    double utilization = 1;
};

struct VirtualChain {
    nanoseconds period{0}, deadline{0}, phase{0};
    std::vector<VirtualTask> tasks;
    int criticality = 1;
    config::OnLate on_late = config::OnLate::kContinue;
    bool is_dead = false;  ///< its GPU work waits for something that never happens
};

struct VirtualOutcome {
    int instances = 0;  ///< that ended, or should have
    int missed = 0;
    int exited = 0;
    nanoseconds longest_hold{0};  ///< of any instance, in all
    double miss_ratio() const { return instances > 0 ? double(missed) / instances : 0; }
};

struct VirtualSettings {
    config::Scheduler scheduler{};
    nanoseconds duration{5'000'000'000};
};

/// @returns what became of each chain
std::vector<VirtualOutcome> run_virtual(const std::vector<VirtualChain>& chains,
                                        const VirtualSettings& settings);

/// @returns the mean of the chains' miss ratios
double mean_miss_ratio(const std::vector<VirtualOutcome>& outcomes);

}  // namespace urgengo::testing
