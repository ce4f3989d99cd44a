// SPDX-License-Identifier: Apache-2.0
#include "tools/discover/observation.h"

#include <map>

namespace urgengo::discover {
namespace {

using trace::TraceKind;
using trace::TraceRecord;

RangeStacks find_stacks(const trace::ThreadTrace& thread) {
    RangeStacks result;
    std::map<std::vector<std::uint64_t>, std::size_t> known;
    std::vector<std::uint64_t> open;
    const auto current = [&] {
        const auto [entry, is_new] = known.emplace(open, result.stacks.size());
        if (is_new) result.stacks.push_back(open);
        return entry->second;
    };
    std::size_t stack = current();
    for (const TraceRecord* event : thread.events) {
        if (event->kind == TraceKind::kRangePush) {
            open.push_back(event->hash);
            stack = current();
        } else if (event->kind == TraceKind::kRangePop && !open.empty()) {
            open.pop_back();
            stack = current();
        } else if (event->kind == TraceKind::kLaunch) {
            result.of_launch.push_back(stack);
        }
    }
    return result;
}

}  // namespace

std::string_view Observation::thread_name(std::size_t thread, std::size_t index) const {
    return trace.threads()[thread].name_at(launch(thread, index).time_ns);
}

std::int64_t Observation::gpu_ns(std::size_t thread, std::size_t index) const {
    const trace::GpuInterval& interval = gpu[thread][index];
    return interval.known ? interval.length_ns() : 0;
}

std::int64_t Observation::total_gpu_ns() const {
    std::int64_t sum = 0;
    for (std::size_t thread = 0; thread < gpu.size(); ++thread) {
        for (std::size_t i = 0; i < gpu[thread].size(); ++i) sum += gpu_ns(thread, i);
    }
    return sum;
}

Observation observe(const trace::Trace& trace, const trace::TaskMatcher& tasks) {
    Observation observation{
        trace, trace::find_segments(trace, tasks), trace::gpu_intervals(trace), {}};
    for (const trace::ThreadTrace& thread : trace.threads()) {
        observation.ranges.push_back(find_stacks(thread));
    }
    return observation;
}

}  // namespace urgengo::discover
