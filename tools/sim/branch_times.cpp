// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/branch_times.h"

#include <algorithm>
#include <utility>

namespace urgengo::sim {
namespace {

using Span = std::pair<nanoseconds, nanoseconds>;

/// @param spans  by their begins
/// @returns the time that any of them covers
nanoseconds covered(const std::vector<Span>& spans) {
    nanoseconds sum{0}, until{0};
    for (const auto& [begin, end] : spans) {
        sum += std::max(end - std::max(begin, until), nanoseconds{0});
        until = std::max(until, end);
    }
    return sum;
}

}  // namespace

BranchTimes branch_times(const std::vector<nanoseconds>& times, const TaskTraits& traits,
                         nanoseconds launch, const GpuShape& shape) {
    ChainTraits all;
    all.tasks.push_back(traits);
    std::vector<nanoseconds> ends(static_cast<std::size_t>(all.num_branches()), nanoseconds{0});
    std::vector<bool> has_run(ends.size());
    std::vector<Span> spans;
    BranchTimes result;
    nanoseconds launched{0}, known{0};
    const auto join = [&](int branch, int other) {
        const auto at = static_cast<std::size_t>(branch), from = static_cast<std::size_t>(other);
        ends[at] = std::max(ends[at], ends[from]);
        has_run[at] = has_run[at] || has_run[from];
    };
    for (std::size_t i = 0; i < times.size(); ++i) {
        const LaunchTraits its = i < traits.launches.size() ? traits.launches[i] : LaunchTraits{};
        if (i > 0) launched += std::max(its.step, launch);
        for (const int other : its.after) join(its.branch, other);
        const auto branch = static_cast<std::size_t>(its.branch);
        const nanoseconds begin = std::max(
            launched + shape.start, has_run[branch] ? ends[branch] + shape.gap : nanoseconds{0});
        ends[branch] = begin + times[i];
        has_run[branch] = true;
        const Span span{begin, ends[branch]};
        spans.insert(std::upper_bound(spans.begin(), spans.end(), span), span);
        result.adds.push_back(covered(spans) - known);
        known += result.adds.back();
    }
    for (const int other : traits.joins) join(0, other);
    result.latency = ends[0];
    return result;
}

}  // namespace urgengo::sim
