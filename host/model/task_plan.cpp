// SPDX-License-Identifier: Apache-2.0
#include "host/model/task_plan.h"

#include <algorithm>
#include <limits>

#include "host/model/graph_name.h"

namespace urgengo::model {
namespace {

/// Between two kernels of a stream that are both launched in time (1 to 1.5 us on an H200).
constexpr nanoseconds kMostGap{2'000};

KernelKey without_size(const KernelKey& key) {
    return {key.name_hash, 0, key.block_threads};
}

KernelKey key_of(const config::KernelProfile& k) {
    return {fnv1a64(k.name), k.grid_blocks, k.block_threads};
}

std::uint32_t saturated(nanoseconds time) {
    return static_cast<std::uint32_t>(
        std::clamp<std::int64_t>(time.count(), 0, std::numeric_limits<std::uint32_t>::max()));
}

nanoseconds times(nanoseconds time, double factor) {
    return nanoseconds(static_cast<std::int64_t>(static_cast<double>(time.count()) * factor));
}

KernelEstimate scaled(const KernelEstimate& from, double factor) {
    return {
        nanoseconds(static_cast<std::int64_t>(static_cast<double>(from.gpu_time.count()) * factor)),
        std::min(1.0, from.utilization * factor)};
}

}  // namespace

TaskPlan::TaskPlan(const config::TaskProfile& profile) : cpu_time_(profile.cpu_time) {
    for (const config::KernelProfile& k : profile.kernels) {
        const KernelKey key = key_of(k);
        kernels_.push_back({.key = key,
                            .gpu_time = k.gpu_time,
                            .utilization_ppm = to_ppm(k.utilization),
                            .launch_time_ns = saturated(k.launch_time)});
        num_with_graphs_ += kernels_of(k.name);
    }
    nanoseconds remaining{0};
    for (auto kernel = kernels_.rbegin(); kernel != kernels_.rend(); ++kernel)
        kernel->remaining = remaining += kernel->gpu_time;
    add_segments(profile);
    add_sizes(profile);
    find_gaps();
    reckon_idle(1, 1);
}

// One segment, from its end: `left`, once launch j goes, is the larger of the GPU work, and of the
// time to the next launch and what is left then.
nanoseconds TaskPlan::reckon_idle(const PlannedSegment& segment, nanoseconds later, double factor,
                                  double pace) {
    nanoseconds work{0}, with_gaps{0}, left{0};
    const std::size_t end = segment.begin + segment.num_launches;
    for (std::size_t j = end; j-- > segment.begin;) {
        PlannedKernel& kernel = kernels_[j];
        if (j + 1 < end) {
            const nanoseconds step(std::int64_t{kernels_[j + 1].launch_time_ns} -
                                   std::int64_t{kernel.launch_time_ns});
            left += times(std::max(step, nanoseconds{0}), pace);
        }
        kernel.idle_after_ns = saturated(later + left - work);
        const nanoseconds time = times(kernel.gpu_time, factor);
        work += time;
        with_gaps += time + segment.gap;
        left = std::max(left, with_gaps);
    }
    return later + left - work;
}

void TaskPlan::reckon_idle(double factor, double pace) {
    idle_ = nanoseconds{0};
    if (segments_.empty()) {
        PlannedSegment whole;
        whole.num_launches = static_cast<std::uint32_t>(kernels_.size());
        idle_ = reckon_idle(whole, idle_, factor, pace);
        return;
    }
    for (auto s = segments_.rbegin(); s != segments_.rend(); ++s)
        idle_ = reckon_idle(*s, idle_, factor, pace);
}

// Kernels on a stream do not follow each other at once: 1 to 2 us each, of which a sum of kernels
// knows nothing. A latency that says more than that was measured beside others.
void TaskPlan::find_gaps() {
    for (PlannedSegment& s : segments_) {
        if (s.latency.count() == 0 || s.num_launches == 0) continue;
        const nanoseconds alone = reckon_idle(s, nanoseconds{0}, 1, 1) + remaining_from(s.begin) -
                                  remaining_from(s.begin + s.num_launches);
        s.gap = std::clamp((s.latency - alone) / s.num_launches, nanoseconds{0}, kMostGap);
    }
}

void TaskPlan::add_segments(const config::TaskProfile& profile) {
    std::size_t begin = 0;
    for (const config::SegmentProfile& s : profile.segments) {
        if (s.num_launches == 0 || begin + s.num_launches > kernels_.size()) break;
        segments_.push_back({begin, s.num_launches, std::min(s.min_launches, s.num_launches),
                             std::max(s.max_launches, s.num_launches), kernels_[begin].key,
                             s.closed_by, s.cpu_time, s.latency});
        begin += s.num_launches;
    }
    // A plan whose segments do not add up to its kernels knows nothing about where it ends.
    if (begin != kernels_.size() || segments_.size() != profile.segments.size()) segments_.clear();
}

double TaskPlan::mean_utilization() const {
    double sum = 0;
    for (const PlannedKernel& k : kernels_)
        sum += k.estimate().utilization * static_cast<double>(k.gpu_time.count());
    return gpu_time().count() > 0 ? sum / static_cast<double>(gpu_time().count()) : 1;
}

std::vector<nanoseconds> TaskPlan::cpu_segments() const {
    if (segments_.empty()) return {cpu_time_};
    std::vector<nanoseconds> times;
    for (const PlannedSegment& s : segments_) times.push_back(s.cpu_time);
    return times;
}

void TaskPlan::add_sizes(const config::TaskProfile& profile) {
    struct Sum {
        nanoseconds gpu_time{0};
        double utilization = 0;
        int count = 0;
    };
    std::unordered_map<KernelKey, Sum, KeyHash> sums;
    // What was learned for each size says more than what stands at the positions.
    for (const auto& k : profile.sizes.empty() ? profile.kernels : profile.sizes) {
        Sum& sum = sums[key_of(k)];
        sum.gpu_time += k.gpu_time;
        sum.utilization += k.utilization;
        ++sum.count;
    }
    for (const auto& [key, sum] : sums) {
        const KernelEstimate mean{sum.gpu_time / sum.count, sum.utilization / sum.count};
        by_key_[key] = mean;
        by_name_[without_size(key)].push_back({key.grid_blocks, mean});
    }
    for (auto& [key, sizes] : by_name_)
        std::sort(sizes.begin(), sizes.end(),
                  [](const Size& a, const Size& b) { return a.grid_blocks < b.grid_blocks; });
}

std::optional<KernelEstimate> TaskPlan::find(std::size_t position, const KernelKey& key) const {
    if (position < kernels_.size() && kernels_[position].key == key)
        return kernels_[position].estimate();
    if (const auto exact = by_key_.find(key); exact != by_key_.end()) return exact->second;
    const auto named = by_name_.find(without_size(key));
    if (named == by_name_.end()) return std::nullopt;
    const std::vector<Size>& sizes = named->second;
    const auto above = std::find_if(sizes.begin(), sizes.end(),
                                    [&](const Size& s) { return s.grid_blocks > key.grid_blocks; });
    const auto ratio = [&](const Size& s) {
        return static_cast<double>(key.grid_blocks) / static_cast<double>(s.grid_blocks);
    };
    if (above == sizes.begin()) return scaled(above->estimate, ratio(*above));
    const Size& below = *std::prev(above);
    if (above == sizes.end()) return scaled(below.estimate, ratio(below));
    const double part = static_cast<double>(key.grid_blocks - below.grid_blocks) /
                        static_cast<double>(above->grid_blocks - below.grid_blocks);
    const auto between = [&](double a, double b) { return a + part * (b - a); };
    return KernelEstimate{nanoseconds(static_cast<std::int64_t>(
                              between(static_cast<double>(below.estimate.gpu_time.count()),
                                      static_cast<double>(above->estimate.gpu_time.count())))),
                          between(below.estimate.utilization, above->estimate.utilization)};
}

std::size_t TaskPlan::reach(std::size_t position, std::size_t end, nanoseconds budget) {
    end = std::min(end, num_kernels());
    if (position >= end) return position;
    PlannedKernel& at = kernels_[position];
    const auto is_within = [&](const PlannedKernel& kernel) {
        return at.remaining - kernel.remaining < budget;
    };
    const std::size_t last = at.reached;
    const bool is_same = last > position && last <= end && is_within(kernels_[last - 1]) &&
                         (last == end || !is_within(kernels_[last]));
    if (is_same) return last;
    const auto first = kernels_.begin();
    const auto reached = std::partition_point(first + static_cast<std::ptrdiff_t>(position),
                                              first + static_cast<std::ptrdiff_t>(end), is_within);
    at.reached = static_cast<std::uint32_t>(reached - first);
    return at.reached;
}

Fit TaskPlan::begins_segment(std::size_t s, const KernelKey& key) const {
    const KernelKey& first = segments_[s].first;
    if (first == key) return Fit::kExact;
    return without_size(first) == without_size(key) ? Fit::kOtherSize : Fit::kNone;
}

std::optional<std::size_t> TaskPlan::find_near_begin(const KernelKey& key) const {
    constexpr std::size_t kNear = 64;
    const std::size_t end =
        std::min<std::size_t>(kNear, segments_.empty() ? 0 : segments_[0].num_launches);
    for (std::size_t i = 0; i < end; ++i)
        if (kernels_[i].key == key) return i;
    return std::nullopt;
}

}  // namespace urgengo::model
