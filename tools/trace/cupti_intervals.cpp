// SPDX-License-Identifier: Apache-2.0
#include "tools/trace/cupti_intervals.h"

#include <algorithm>
#include <unordered_map>
#include <unordered_set>

namespace urgengo::trace {
namespace {

struct Call {
    std::vector<Span> kernels;
    bool is_timed = true;  ///< all of them
};
/// By its id.
using Calls = std::unordered_map<std::uint32_t, Call>;

Calls calls_of(const Trace& trace, const CuptiClock& clock) {
    Calls calls;
    for (const TraceRecord* record : trace.kernel_times()) {
        const auto& kernel = record->kernel;
        Call& call = calls[kernel.correlation];
        if (kernel.begin == 0 || kernel.end < kernel.begin) {
            call.is_timed = false;
        } else {
            call.kernels.push_back(
                {clock.to_monotonic(kernel.begin), clock.to_monotonic(kernel.end)});
        }
    }
    return calls;
}

void fill(GpuInterval& interval, std::vector<Span> kernels) {
    std::sort(kernels.begin(), kernels.end(),
              [](const Span& a, const Span& b) { return a.begin_ns < b.begin_ns; });
    interval.known = true;
    interval.begin_ns = kernels.front().begin_ns;
    interval.end_ns = interval.begin_ns;
    for (const Span& kernel : kernels) {
        interval.end_ns = std::max(interval.end_ns, kernel.end_ns);
    }
    if (kernels.size() > 1) interval.parts = std::move(kernels);
}

/// @param with_kernels  hashes of their names; graphs have no kernels of which no launch ever had a
///                      record
void fill_empty_graphs(std::vector<std::vector<GpuInterval>>& launches,
                       const std::unordered_set<std::uint64_t>& with_kernels) {
    for (auto& thread : launches) {
        for (GpuInterval& interval : thread) {
            const TraceRecord& launch = *interval.launch;
            if (interval.known || !(launch.flags & abi::kTraceGraph)) continue;
            if (with_kernels.count(launch.launch.name_hash) > 0) continue;
            interval.known = true;
            interval.begin_ns = interval.end_ns = launch.time_ns;
        }
    }
}

}  // namespace

CuptiClock::CuptiClock(const std::vector<const TraceRecord*>& pairs) {
    for (const TraceRecord* pair : pairs) pairs_.push_back({pair->cupti_ns, pair->time_ns});
    std::sort(pairs_.begin(), pairs_.end(),
              [](const Pair& a, const Pair& b) { return a.cupti_ns < b.cupti_ns; });
    const auto last = std::unique(pairs_.begin(), pairs_.end(), [](const Pair& a, const Pair& b) {
        return a.cupti_ns == b.cupti_ns;
    });
    pairs_.erase(last, pairs_.end());
}

std::int64_t CuptiClock::to_monotonic(std::uint64_t cupti_ns) const {
    const auto since = [cupti_ns](const Pair& pair) {
        return static_cast<std::int64_t>(cupti_ns - pair.cupti_ns);
    };
    if (pairs_.size() == 1) return pairs_[0].monotonic_ns + since(pairs_[0]);
    auto after =
        std::upper_bound(pairs_.begin(), pairs_.end(), cupti_ns,
                         [](std::uint64_t time, const Pair& pair) { return time < pair.cupti_ns; });
    after = std::clamp(after, pairs_.begin() + 1, pairs_.end() - 1);
    const Pair &a = *(after - 1), &b = *after;
    const double rate = static_cast<double>(b.monotonic_ns - a.monotonic_ns) /
                        static_cast<double>(b.cupti_ns - a.cupti_ns);
    return a.monotonic_ns + static_cast<std::int64_t>(static_cast<double>(since(a)) * rate);
}

CuptiIntervals cupti_intervals(const Trace& trace) {
    CuptiIntervals found;
    for (const ThreadTrace& thread : trace.threads()) {
        std::vector<GpuInterval>& launches = found.launches.emplace_back();
        for (const TraceRecord* event : thread.events) {
            if (event->kind == TraceKind::kLaunch) launches.push_back({event});
        }
    }
    const CuptiClock clock(trace.clock_pairs());
    if (!clock.is_known()) return found;
    Calls calls = calls_of(trace, clock);
    std::unordered_set<std::uint64_t> with_kernels;
    for (auto& thread : found.launches) {
        for (GpuInterval& interval : thread) {
            if (!(interval.launch->flags & abi::kTraceCorrelated)) continue;
            const auto ids = interval.launch->launch.correlations;
            auto call = calls.end();
            if (ids.driver != 0) call = calls.find(ids.driver);
            if (call == calls.end() && ids.runtime != 0) call = calls.find(ids.runtime);
            if (call == calls.end()) continue;
            with_kernels.insert(interval.launch->launch.name_hash);
            // What was timed of it nevertheless kept the GPU busy: it stays among `calls`.
            if (!call->second.is_timed) continue;
            fill(interval, std::move(call->second.kernels));
            calls.erase(call);
        }
    }
    fill_empty_graphs(found.launches, with_kernels);
    for (const auto& [id, call] : calls) {
        for (const Span& kernel : call.kernels) {
            GpuInterval& other = found.others.emplace_back();
            other.known = true;
            other.begin_ns = kernel.begin_ns;
            other.end_ns = kernel.end_ns;
        }
    }
    return found;
}

}  // namespace urgengo::trace
