// SPDX-License-Identifier: Apache-2.0
//
// The host's cores in virtual time: threads that compute, or spin while they wait, share them
// evenly once there are more threads than cores. Threads that sleep wake up a little late.
#pragma once

#include <algorithm>
#include <cstdint>
#include <random>
#include <vector>

#include "tools/sim/fluid_clock.h"

namespace urgengo::sim {

struct CpuShape {
    int num_cores = 16;
    /// From when a sleep should end to when its thread runs: the least (measured: 50 us asked for
    /// take 79), and the mean of what comes on top, log-normally.
    nanoseconds wake_up{29'000};
    nanoseconds wake_up_tail{5'000};
    /// Threads that launch share the driver's locks: k of them get k * c / (k + c - 1) done
    /// together, in what one gets done alone; 0: they share nothing. (Seven traced networks,
    /// H100: 1.3 with two, 1.7 with three, 1.6 to 2.7 with more, which is a c of 2.7;
    /// docs/measurements.md.)
    double launch_capacity = 0;
};

class CpuModel {
  public:
    CpuModel(const CpuShape& shape, std::uint32_t seed) : shape_(shape), random_(seed) {}

    /// The thread computes for so long, on a core of its own; advance() says when it is done.
    void compute(int thread, nanoseconds work);
    /// The same of a launch.
    void launch(int thread, nanoseconds work);
    /// The thread waits on its core, or ceases to.
    void begin_spin();
    void end_spin();
    /// @returns how much later than it asked for a sleeping thread wakes up
    nanoseconds wake_up_delay();

    /// All threads stand still, or go on.
    void stall(bool is_stalled, nanoseconds now);

    nanoseconds next() const {
        return is_stalled_ ? kNever : std::min(clock_.next(), launching_.next());
    }
    /// Lets time pass: no further than next().
    /// @returns the threads that are done, in order
    const std::vector<int>& advance(nanoseconds now);

    /// @returns what all threads have had, in seconds on a core
    double core_seconds() const { return core_ns_ * 1e-9; }

  private:
    void pass(nanoseconds now);
    void share();

    const CpuShape shape_;
    std::mt19937_64 random_;
    std::lognormal_distribution<double> any_tail_{-0.5, 1};  ///< of mean 1
    FluidClock clock_, launching_;
    nanoseconds now_{0};
    int runnable_ = 0, num_launching_ = 0;
    bool is_stalled_ = false;
    double core_ns_ = 0;
    std::vector<int> done_;
};

}  // namespace urgengo::sim
