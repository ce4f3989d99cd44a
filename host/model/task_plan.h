// SPDX-License-Identifier: Apache-2.0
//
// What is known of a task before it runs: its launches in order, each with GPU time E_k and
// utilisation U_k (the paper's lookup table, Tab. 1), and the GPU time that remains from every
// position on.
//
// Built once from the profile, then only read, by any thread. A launch is looked up by its
// position; if another kernel stands there (a frame with more or fewer launches), by name and size;
// if it is unknown altogether, the plan says so and the caller uses its own average.
#pragma once

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "host/base/hash.h"
#include "host/config/config.h"

namespace urgengo::model {

using std::chrono::nanoseconds;

/// Identifies a kernel across handles and processes: its name, and how large it is launched.
struct KernelKey {
    std::uint64_t name_hash = 0;
    std::uint64_t grid_blocks = 0;
    std::uint32_t block_threads = 0;

    friend bool operator==(const KernelKey&, const KernelKey&) = default;
};

struct KernelEstimate {
    nanoseconds gpu_time{0};
    double utilization = 1;  ///< 0..1
};

class TaskPlan {
  public:
    TaskPlan() = default;
    explicit TaskPlan(const config::TaskProfile& profile);

    /// @returns the estimate of the launch at `position`, or null if the kernel is unknown
    const KernelEstimate* find(std::size_t position, const KernelKey& key) const;

    /// @returns GPU time of the launches from `position` on; 0 at and past the end
    nanoseconds remaining_from(std::size_t position) const {
        return position < remaining_.size() ? remaining_[position] : nanoseconds{0};
    }

    nanoseconds gpu_time() const { return remaining_from(0); }
    nanoseconds cpu_time() const { return cpu_time_; }
    std::size_t num_kernels() const { return estimates_.size(); }

  private:
    struct KeyHash {
        std::size_t operator()(const KernelKey& k) const {
            return k.name_hash ^ (k.grid_blocks * 0x9e3779b97f4a7c15u) ^ k.block_threads;
        }
    };

    nanoseconds cpu_time_{0};
    std::vector<KernelKey> keys_;  // shape [num_kernels], as the two below
    std::vector<KernelEstimate> estimates_;
    std::vector<nanoseconds> remaining_;
    std::unordered_map<KernelKey, KernelEstimate, KeyHash> by_key_;  // mean over positions
};

}  // namespace urgengo::model
