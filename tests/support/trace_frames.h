// SPDX-License-Identifier: Apache-2.0
//
// Traces of one or two tasks, and what is found in them.
#pragma once

#include <deque>
#include <random>

#include "tests/support/catch.h"
#include "tests/support/trace_builder.h"
#include "tools/trace/instances.h"

namespace urgengo::trace {

using namespace std::chrono_literals;
using abi::TraceWait;
using testing::TestKernel;
using testing::TraceBuilder;
using testing::TracedThread;

inline constexpr std::int64_t kMs = 1'000'000;

inline config::Config one_task(config::Task task, std::chrono::nanoseconds period = 20ms) {
    task.name = "t";
    config::Config config;
    config.chains.push_back({"C0", period, period, {}, {task}});
    return config;
}

inline config::Config two_tasks(config::Task a, config::Task b) {
    config::Config config = one_task(std::move(a));
    b.name = "u";
    config.chains.push_back({"C1", 20ms, 20ms, {}, {b}});
    return config;
}

inline TaskInstances learn(TraceBuilder& builder, const config::Config& config, int task = 0) {
    static std::deque<Trace> traces;  // what is found in them points into them
    auto trace = parse_trace(builder.bytes(), "a.trace");
    REQUIRE(trace);
    const Trace& kept = traces.emplace_back(std::move(*trace));
    const auto segments = find_segments(kept, TaskMatcher(config, kept));
    return find_instances(segments_of(segments, task), config.chains[0].period);
}

inline std::vector<std::size_t> launch_counts(const TaskInstances& task) {
    std::vector<std::size_t> counts;
    for (const Instance& instance : task.instances) counts.push_back(instance.num_launches);
    return counts;
}

inline void launch_many(TracedThread& thread, const std::string& name, int count, int task = -1) {
    for (int i = 0; i < count; ++i) thread.launch({name, 10, 64, 20'000}, task);
}

/// Three segments: an upload whose wait does not matter, a backbone, a head that closes the frame.
inline void detector_frame(TracedThread& thread, int head_launches = 3) {
    thread.compute(300'000);
    launch_many(thread, "preprocess", 2);
    thread.wait(TraceWait::kCopy);
    thread.compute(50'000);
    launch_many(thread, "backbone", 8);
    thread.wait(TraceWait::kEvent);
    thread.compute(80'000);
    launch_many(thread, "head", head_launches);
    thread.wait();
}

}  // namespace urgengo::trace
