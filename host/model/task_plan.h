// SPDX-License-Identifier: Apache-2.0
//
// What is known of a task before it runs: its launches in order, each with GPU time E_k and
// utilisation U_k (the paper's lookup table, Tab. 1), how they fall into GPU segments, and the time
// that remains from every position on.
//
// Built once from the profile, then only read, by any thread, but for the handles and what reach()
// remembers. A launch is looked up by its position; if another kernel or size stands there (a frame
// with more launches, or with more points), by name and size; if that size was never seen, between
// its neighbours in size; if the kernel is unknown altogether, the plan says so.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
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

/// @returns what stands for a kernel of this size in logs; never 0
constexpr std::uint64_t kernel_id(const KernelKey& key) {
    std::uint64_t id = key.name_hash;
    for (std::uint64_t part : {key.grid_blocks, std::uint64_t{key.block_threads}})
        id = ((id ^ part) * 0x9e3779b97f4a7c15u) ^ (id >> 32);
    return id != 0 ? id : 1;
}

constexpr std::uint32_t to_ppm(double share) {
    return static_cast<std::uint32_t>(share * 1e6 + 0.5);
}

struct KernelEstimate {
    nanoseconds gpu_time{0};
    double utilization = 1;  ///< 0..1
};

/// A launch of the plan. What a launch that goes as planned is compared with, and what it leaves
/// behind, on one cache line.
struct alignas(64) PlannedKernel {
    KernelKey key;
    nanoseconds gpu_time{0};
    std::uint32_t utilization_ppm = 0;
    std::uint32_t reached = 0;  ///< what TaskPlan::reach() answered last, from this launch on
    /// Alone, behind this launch: what the GPU waits for launches until all are executed;
    /// saturated.
    std::uint32_t idle_after_ns = 0;
    std::uint32_t launch_time_ns = 0;  ///< KernelProfile::launch_time, saturated
    nanoseconds remaining{0};          ///< GPU time from this launch on, with it
    /// The handle by which it was launched last, while that is good: what a launch is known by
    /// without asking for its name. Of the thread that runs the task only.
    const void* function = nullptr;

    KernelEstimate estimate() const { return {gpu_time, utilization_ppm / 1e6}; }
    std::uint64_t id() const { return kernel_id(key); }
};
static_assert(sizeof(PlannedKernel) == 64);

/// How well a kernel fits a place in the plan.
enum class Fit { kNone, kOtherSize, kExact };

/// A GPU segment: launches up to the wait that closes it.
struct PlannedSegment {
    std::size_t begin = 0;  ///< position of its first launch
    std::uint32_t num_launches = 0;
    std::uint32_t min_launches = 0;  ///< in any instance of the profile
    std::uint32_t max_launches = 0;
    KernelKey first;
    std::string closed_by;    ///< SegmentProfile::closed_by
    nanoseconds cpu_time{0};  ///< of the CPU segment before it
    nanoseconds latency{0};   ///< SegmentProfile::latency
    nanoseconds gap{0};       ///< between its kernels, on the GPU: what `latency` says beyond them
};

class TaskPlan {
  public:
    TaskPlan() = default;
    explicit TaskPlan(const config::TaskProfile& profile);

    /// @returns the estimate of the launch at `position`, or nothing if the kernel is unknown
    std::optional<KernelEstimate> find(std::size_t position, const KernelKey& key) const;

    /// @returns GPU time of the launches from `position` on; 0 at and past the end
    nanoseconds remaining_from(std::size_t position) const {
        return position < kernels_.size() ? kernels_[position].remaining : nanoseconds{0};
    }

    /// A task that launches more slowly than the GPU executes needs, alone, more time than the GPU
    /// has to work for it: this is the difference, from `position` on. Alone, a segment is over
    ///
    ///     max over its launches j of (o_j + f * (E_j + E_j+1 + ...))
    ///
    /// after its first launch, where o_j is when j is launched and f what estimates are multiplied
    /// by; E_j here with the gap on the GPU behind each kernel, which the segment's latency tells.
    /// What is launched and not executed yet takes from it (model/slot_view.cpp).
    /// @returns 0 at and past the end, and where the profile does not know launch times
    nanoseconds idle_from(std::size_t position) const {
        if (position == 0) return idle_;
        return nanoseconds(position <= kernels_.size() ? kernels_[position - 1].idle_after_ns : 0);
    }
    /// @returns when the launch before `position` is, from its segment's first one on, by the
    /// profile
    nanoseconds launch_time(std::size_t position) const {
        const bool is_known = position > 0 && position <= kernels_.size();
        return nanoseconds(is_known ? kernels_[position - 1].launch_time_ns : 0);
    }
    /// Reckons idle_from() anew, with GPU times multiplied by `factor` and launch times by `pace`.
    /// Takes time linear in the launches: when an instance has ended.
    void reckon_idle(double factor, double pace);

    /// @returns the first position from `position` on before which the launches since there take
    ///          `budget` of GPU time or more; `end` if none before it does
    /// @threads one at a time: it remembers the answer, which mostly is the same in every instance,
    ///          and a search takes a cache line a step
    std::size_t reach(std::size_t position, std::size_t end, nanoseconds budget);

    /// @param position  < num_kernels()
    const PlannedKernel& at(std::size_t position) const { return kernels_[position]; }
    PlannedKernel& at(std::size_t position) { return kernels_[position]; }

    /// Handles may come to mean other kernels.
    void forget_functions() {
        for (PlannedKernel& kernel : kernels_) kernel.function = nullptr;
    }

    nanoseconds gpu_time() const { return remaining_from(0); }
    /// @returns utilisation of the kernels, weighted by their time; 1 without any
    double mean_utilization() const;
    /// @returns time of the CPU segment before each GPU segment; all in one without segments
    std::vector<nanoseconds> cpu_segments() const;
    std::size_t num_kernels() const { return kernels_.size(); }
    /// The same, each graph's counted one by one.
    std::size_t num_with_graphs() const { return num_with_graphs_; }
    /// @returns how many kernels a launch is, in the mean: graphs are many
    double kernels_of_launch() const {
        return is_empty()
                   ? 1
                   : static_cast<double>(num_with_graphs_) / static_cast<double>(kernels_.size());
    }
    /// No profile knows the task: all its kernels are unknown.
    bool is_empty() const { return kernels_.empty(); }
    /// In order; empty if the profile does not say.
    const std::vector<PlannedSegment>& segments() const { return segments_; }
    /// @returns whether segment `s` begins with such a kernel
    Fit begins_segment(std::size_t s, const KernelKey& key) const;

    /// @returns at which position near the plan's begin such a kernel stands, if anywhere: for
    /// tasks
    ///          that are known by a later kernel than their first
    std::optional<std::size_t> find_near_begin(const KernelKey& key) const;

  private:
    struct KeyHash {
        std::size_t operator()(const KernelKey& k) const {
            return k.name_hash ^ (k.grid_blocks * 0x9e3779b97f4a7c15u) ^ k.block_threads;
        }
    };
    struct Size {
        std::uint64_t grid_blocks = 0;
        KernelEstimate estimate;
    };

    void add_segments(const config::TaskProfile& profile);
    nanoseconds reckon_idle(const PlannedSegment& segment, nanoseconds later, double factor,
                            double pace);
    void add_sizes(const config::TaskProfile& profile);
    void find_gaps();

    nanoseconds cpu_time_{0};
    std::size_t num_with_graphs_ = 0;
    nanoseconds idle_{0};  ///< from the first launch on
    std::vector<PlannedKernel> kernels_;
    std::vector<PlannedSegment> segments_;
    std::unordered_map<KernelKey, KernelEstimate, KeyHash> by_key_;
    // Grid 0 in the key: every size of a kernel with so many threads a block, by grid.
    std::unordered_map<KernelKey, std::vector<Size>, KeyHash> by_name_;
};

}  // namespace urgengo::model
