// SPDX-License-Identifier: Apache-2.0
//
// Launch pace and latency from a run in which nothing is timed, and whether times add up.
#include "tools/trace/pace_learner.h"

#include <algorithm>

#include "tests/support/catch.h"
#include "tests/support/trace_builder.h"
#include "tools/trace/profile_builder.h"
#include "tools/trace/profile_merge.h"

namespace urgengo::trace {
namespace {

using namespace std::chrono_literals;
using config::TaskProfile;
using std::chrono::nanoseconds;
using testing::TraceBuilder;
using testing::TracedThread;

constexpr std::int64_t kUs = 1000, kMs = 1'000'000;

/// Three launches, each `pace_ns` after the one before, and a wait; then one more and its wait.
void frames(TraceBuilder& builder, std::int64_t pace_ns, int count, std::int64_t gpu_ns = 100 * kUs,
            bool is_plain = false) {
    TracedThread thread(builder, 7, "det");
    for (int i = 0; i < count; ++i) {
        thread.sleep_until((i + 1) * 20 * kMs);
        thread.compute(300 * kUs);
        for (const char* name : {"a", "b", "c"}) {
            thread.launch({name, 8, 128, gpu_ns, 0.5});
            thread.compute(pace_ns - TracedThread::kLaunchNs);
        }
        thread.wait();
        thread.compute(40 * kUs);
        thread.launch({"d", 8, 128, gpu_ns, 0.5});
        thread.wait();
    }
    if (is_plain) builder.header.mark_ns = 0;
}

config::Config config_of() {
    config::Config config;
    config.chains.push_back({"C0", 20ms, 20ms, {}, {{"t", "det"}}});
    return config;
}

Trace parse(TraceBuilder& builder) {
    auto trace = parse_trace(builder.bytes(), "a.trace");
    REQUIRE(trace);
    return std::move(*trace);
}

bool has_warning(const LearnedProfile& learned, const std::string& text) {
    return std::any_of(
        learned.warnings.begin(), learned.warnings.end(),
        [&](const std::string& each) { return each.find(text) != std::string::npos; });
}

TEST_CASE("Pace is that of the run in which nothing is timed", "[unit][trace]") {
    TraceBuilder timed, untimed;
    untimed.header.mark_ns = 0;
    frames(timed, 40 * kUs, 20);
    frames(untimed, 10 * kUs, 20, 100 * kUs, true);
    const Trace trace = parse(timed), plain = parse(untimed);
    const LearnedProfile learned = learn_profile(trace, config_of(), "stack", &plain);
    const TaskProfile& task = learned.profile.chains[0].tasks[0];
    REQUIRE(task.kernels.size() == 4);
    CHECK(task.kernels[0].launch_time == 0us);
    CHECK(task.kernels[1].launch_time == 10us);
    CHECK(task.kernels[2].launch_time == 20us);
    CHECK(task.kernels[3].launch_time == 0us);  // of a segment of its own
    REQUIRE(task.segments.size() == 2);
    CHECK(task.segments[0].latency == 307us);  // 5 to the launch's end, 3 kernels, 2 back
    CHECK(task.segments[1].latency == 107us);
    CHECK(task.segments[0].cpu_time == 300us);
    CHECK(learned.tasks[0].pace.instances == 20);
    CHECK(learned.tasks[0].pace.alone == 20);
    CHECK(learned.warnings.empty());
}

TEST_CASE("Pace is not known from the timed run alone", "[unit][trace]") {
    TraceBuilder timed;
    frames(timed, 40 * kUs, 20);
    const Trace trace = parse(timed);
    const TaskProfile task = learn_profile(trace, config_of(), "stack").profile.chains[0].tasks[0];
    for (const auto& kernel : task.kernels) CHECK(kernel.launch_time == 0us);
    for (const auto& segment : task.segments) CHECK(segment.latency == 0us);
    CHECK(task.segments[0].cpu_time == 300us);
}

TEST_CASE("Pace is not known when the second run is of another shape, and that is said",
          "[unit][trace]") {
    TraceBuilder timed, untimed;
    frames(timed, 40 * kUs, 20);
    TracedThread thread(untimed, 7, "det");
    for (int i = 0; i < 20; ++i) {
        thread.sleep_until((i + 1) * 20 * kMs);
        thread.launch({"another", 8, 128, 50 * kUs, 0.5});
        thread.wait();
    }
    const Trace trace = parse(timed), plain = parse(untimed);
    const LearnedProfile learned = learn_profile(trace, config_of(), "stack", &plain);
    CHECK(learned.profile.chains[0].tasks[0].kernels.at(1).launch_time == 0us);
    CHECK(has_warning(learned, "no instance of the run without timing is like"));
}

TEST_CASE("Pace counts instances with nothing beside them, if there are some", "[unit][trace]") {
    TraceBuilder timed, untimed;
    frames(timed, 40 * kUs, 20);
    untimed.header.mark_ns = 0;
    TracedThread thread(untimed, 7, "det"), other(untimed, 8, "other");
    for (int i = 0; i < 20; ++i) {
        const bool beside = i % 4 != 0;
        thread.sleep_until((i + 1) * 20 * kMs);
        other.sleep_until((i + 1) * 20 * kMs + (beside ? 0 : 10 * kMs));
        other.launch({"theirs", 8, 128, kMs, 0.5});
        other.wait();
        for (const char* name : {"a", "b", "c"}) {
            thread.launch({name, 8, 128, beside ? 50 * kUs : 100 * kUs, 0.5});
            thread.compute(5 * kUs);
        }
        thread.wait();
        thread.compute(40 * kUs);
        thread.launch({"d", 8, 128, 100 * kUs, 0.5});
        thread.wait();
    }
    const Trace trace = parse(timed), plain = parse(untimed);
    const LearnedProfile learned = learn_profile(trace, config_of(), "stack", &plain);
    CHECK(learned.tasks[0].pace.instances == 20);
    CHECK(learned.tasks[0].pace.alone == 5);
    CHECK(learned.profile.chains[0].tasks[0].segments.at(0).latency == 307us);
}

TEST_CASE("Check scales times that are longer than the task is alone, and calls them a guess",
          "[unit][trace]") {
    TraceBuilder timed, untimed;
    untimed.header.mark_ns = 0;
    frames(timed, 40 * kUs, 20, 400 * kUs);
    frames(untimed, 10 * kUs, 20, 100 * kUs, true);
    const Trace trace = parse(timed), plain = parse(untimed);
    const LearnedProfile learned = learn_profile(trace, config_of(), "stack", &plain);
    const TaskProfile& task = learned.profile.chains[0].tasks[0];
    CHECK(learned.tasks[0].verdict == Verdict::kGuess);
    CHECK(has_warning(learned, "are a guess"));
    CHECK(std::abs((busy_time(task) - latency(task)).count()) < 10);
    for (const auto& kernel : task.kernels) CHECK(kernel.samples == 0);
}

TEST_CASE("Check refuses kernels that take no time", "[unit][trace]") {
    TaskProfile task;
    task.kernels.resize(3);
    task.segments.resize(1);
    const Check check = check_times(task, {});
    CHECK(check.verdict == Verdict::kRefused);
    CHECK(task.kernels.empty());
}

TEST_CASE("Check refuses a forked task that marks have timed", "[unit][trace]") {
    TaskProfile task;
    task.kernels.resize(2);
    for (auto& kernel : task.kernels) kernel.gpu_time = 100us;
    task.kernels[1].stream = 1;
    const TaskTimes times{200us, 100us, 2, false};
    TaskProfile by_cupti = task, hardly = task;
    CHECK(check_times(task, times).verdict == Verdict::kRefused);
    CHECK(check_times(by_cupti, {200us, 100us, 2, true}).verdict == Verdict::kAddsUp);
    CHECK(check_times(hardly, {200us, 5us, 2, false}).verdict == Verdict::kAddsUp);
}

TEST_CASE("Merging keeps launch times and latencies that one profile lacks", "[unit][trace]") {
    config::Profile older, newer;
    older.gpu = newer.gpu = "Test GPU";
    TaskProfile task;
    task.name = "t";
    task.instances = 10;
    task.kernels.resize(2);
    task.kernels[0].name = "a", task.kernels[1].name = "b";
    task.segments.push_back({1ms, 2, 2, 2, "stream", 0ms});
    older.chains.push_back({"C0", {task}});
    task.kernels[1].launch_time = 30us;
    task.segments[0].latency = 5ms;
    newer.chains.push_back({"C0", {task}});
    const auto merged = merge_profiles(older, newer);
    REQUIRE(merged);
    CHECK(merged->chains[0].tasks[0].kernels[1].launch_time == 30us);
    CHECK(merged->chains[0].tasks[0].segments[0].latency == 5ms);
    older.chains[0].tasks[0].kernels[1].launch_time = 10us;
    older.chains[0].tasks[0].segments[0].latency = 3ms;
    const auto mean = merge_profiles(older, newer);
    REQUIRE(mean);
    CHECK(mean->chains[0].tasks[0].kernels[1].launch_time == 20us);
    CHECK(mean->chains[0].tasks[0].segments[0].latency == 4ms);
}

}  // namespace
}  // namespace urgengo::trace
