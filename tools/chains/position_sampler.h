// SPDX-License-Identifier: Apache-2.0
//
// Asks UrgenGo at random times where the GPU is in the tasks that run, for the comparison with what
// the kernels' own stamps say afterwards. One thread that sleeps between: distances are
// exponential, so that it meets every phase of a task equally often. It allocates nothing while it
// runs, and says what it could not keep.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <string>
#include <thread>
#include <vector>

#include "tools/chains/task_runs.h"
#include "urgengo/urgengo.h"

namespace urgengo::chains {

/// One answer, as written to a file. Host times are CLOCK_MONOTONIC.
struct PositionSample {
    enum Flags : std::uint16_t { kAnswered = 1, kBusy = 2, kOverdue = 4 };
    std::int64_t before_ns = 0;  ///< read before the question
    std::uint32_t took_ns = 0;   ///< until after the answer
    std::uint16_t target = 0;
    std::uint16_t flags = 0;  ///< not answered: the rest is 0
    std::uint32_t run = 0;    ///< of the target, the one under way before and after
    std::uint32_t launch = 0;
    std::uint32_t instance = 0;
    std::uint32_t reserved = 0;
    std::int64_t remaining_ns = 0, unexecuted_ns = 0, uncertain_ns = 0;
};
static_assert(sizeof(PositionSample) == 56, "written to a file");

class PositionSampler {
  public:
    /// A thread whose tasks are looked at; all outlive the sampler.
    struct Target {
        std::string chain;
        std::vector<std::string> tasks;
        const TaskRuns* runs;
    };
    struct Summary {
        std::uint64_t wakes = 0;
        std::uint64_t lost = 0;     ///< there was no room
        std::uint64_t changed = 0;  ///< the task changed while asked
        double cpu_s = 0;
        double wall_s = 0;
    };

    /// @param mean  of the distances
    /// @param room  samples that are kept
    PositionSampler(const ug_hints& hints, std::vector<Target> targets,
                    std::chrono::nanoseconds mean, std::size_t room, std::uint32_t seed);
    ~PositionSampler() { stop(); }

    void start();
    void stop();
    /// After stop().
    const std::vector<PositionSample>& samples() const { return samples_; }
    const Summary& summary() const { return summary_; }

  private:
    void run();
    void look();

    const ug_hints& hints_;
    const std::vector<Target> targets_;
    const std::chrono::nanoseconds mean_;
    const std::uint32_t seed_;
    std::vector<PositionSample> samples_;
    Summary summary_;
    std::atomic<bool> stop_{false};
    std::thread thread_;
};

}  // namespace urgengo::chains
