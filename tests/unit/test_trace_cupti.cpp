// SPDX-License-Identifier: Apache-2.0
//
// Profiles from CUPTI's records: whose launch a record is of, clocks, graphs, several streams, what
// is missing.
#include "tools/trace/cupti_intervals.h"

#include <algorithm>

#include "tests/support/catch.h"
#include "tests/support/trace_builder.h"
#include "tools/trace/busy_time.h"
#include "tools/trace/profile_builder.h"

namespace urgengo::trace {
namespace {

using namespace std::chrono_literals;
using config::TaskProfile;
using testing::TraceBuilder;

constexpr std::int64_t kUs = 1000, kMs = 1'000'000;
/// CUPTI's clock is this far ahead of ours.
constexpr std::uint64_t kAhead = 1'700'000'000'000'000'000;
constexpr std::uint32_t kThread = 7, kCuptiThread = 99;

/// A program whose kernels CUPTI times: it may lose some.
class CuptiTrace {
  public:
    CuptiTrace() {
        builder.header.kernel_times = abi::TraceTimes::kCupti;
        std::strcpy(builder.add(kThread, TraceKind::kThread, 0).name, "det");
        clocks(0);
    }

    void clocks(std::int64_t time_ns) {
        builder.add(kCuptiThread, TraceKind::kClockPair, time_ns).cupti_ns =
            kAhead + static_cast<std::uint64_t>(time_ns);
    }

    /// @returns the launch's record; valid until the next one is added
    TraceRecord& launch(const std::string& name, std::int64_t time_ns, std::uint64_t stream = 1,
                        std::uint8_t flags = 0, std::uint32_t thread = kThread) {
        const std::uint64_t hash = builder.text(thread, name);
        TraceRecord& record = builder.add(thread, TraceKind::kLaunch, time_ns);
        record.flags = static_cast<std::uint8_t>(flags | abi::kTraceCorrelated);
        record.launch.name_hash = hash;
        record.launch.stream = stream;
        record.launch.grid_blocks = 8;
        record.launch.block_threads = 128;
        record.launch.utilization = 30000;
        record.launch.correlations = {++last_id, 0};
        return record;
    }

    void kernel(std::uint32_t id, std::int64_t begin_ns, std::int64_t end_ns) {
        TraceRecord& record = builder.add(kCuptiThread, TraceKind::kKernelTime, 0);
        record.kernel.begin = kAhead + static_cast<std::uint64_t>(begin_ns);
        record.kernel.end = kAhead + static_cast<std::uint64_t>(end_ns);
        record.kernel.correlation = id;
    }

    void wait(std::int64_t begin_ns, std::int64_t end_ns) {
        TraceRecord& record = builder.add(kThread, TraceKind::kWait, begin_ns);
        record.flags = abi::kTraceCovers;
        record.wait.end_ns = end_ns;
    }

    Trace trace() {
        auto trace = parse_trace(builder.bytes(), "a.trace");
        REQUIRE(trace);
        return std::move(*trace);
    }

    LearnedProfile learn() {
        config::Config config;
        config.chains.push_back({"C0", 20ms, 20ms, {}, {{"t", "det"}}});
        const Trace parsed = trace();
        return learn_profile(parsed, config, "stack");
    }

    TraceBuilder builder;
    std::uint32_t last_id = 0;
};

/// An eager network: launched every 20 us, each kernel takes 5 us.
void eager_frames(CuptiTrace& trace, int frames, std::uint32_t lost = 0) {
    for (int i = 0; i < frames; ++i) {
        const std::int64_t begin_ns = (i + 1) * 20 * kMs;
        for (int k = 0; k < 4; ++k) {
            const std::int64_t at_ns = begin_ns + k * 20 * kUs;
            trace.launch("layer" + std::to_string(k), at_ns);
            if (trace.last_id == lost) continue;
            trace.kernel(trace.last_id, at_ns + 8 * kUs, at_ns + (13 + k) * kUs);
        }
        trace.wait(begin_ns + 80 * kUs, begin_ns + 90 * kUs);
    }
    trace.clocks((frames + 2) * 20 * kMs);
}

bool has_warning(const LearnedProfile& learned, const std::string& text) {
    return std::any_of(
        learned.warnings.begin(), learned.warnings.end(),
        [&](const std::string& each) { return each.find(text) != std::string::npos; });
}

TEST_CASE("BusyTime grows by what is not covered yet", "[unit][trace]") {
    BusyTime busy;
    CHECK(busy.add(10, 20) == 10);
    CHECK(busy.add(30, 40) == 10);
    CHECK(busy.add(12, 18) == 0);
    CHECK(busy.add(15, 35) == 10);  // closes the gap
    CHECK(busy.add(40, 50) == 10);  // right behind
    CHECK(busy.add(5, 60) == 15);   // around all
    CHECK(busy.add(7, 7) == 0);
    CHECK(busy.add(100, 90) == 0);
    CHECK(busy.total_ns() == 55);
}

TEST_CASE("CuptiClock is linear between pairs, and goes on beyond them", "[unit][trace]") {
    TraceRecord a{}, b{}, c{};
    a.cupti_ns = 1000, a.time_ns = 500;
    b.cupti_ns = 2000, b.time_ns = 1500;
    c.cupti_ns = 3000, c.time_ns = 3500;  // the clock was set
    const CuptiClock clock({&c, &a, &b});
    CHECK(clock.to_monotonic(1500) == 1000);
    CHECK(clock.to_monotonic(2500) == 2500);
    CHECK(clock.to_monotonic(800) == 300);
    CHECK(clock.to_monotonic(3500) == 4500);
    CHECK(CuptiClock({&a}).to_monotonic(900) == 400);
    CHECK_FALSE(CuptiClock({}).is_known());
}

TEST_CASE("Profile by CUPTI has the kernels' own times however slowly they are launched",
          "[unit][trace]") {
    CuptiTrace trace;
    eager_frames(trace, 10);
    const LearnedProfile learned = trace.learn();
    const TaskProfile& task = learned.profile.chains[0].tasks[0];
    REQUIRE(task.kernels.size() == 4);
    CHECK(task.instances == 10);
    for (int k = 0; k < 4; ++k) CHECK(task.kernels[k].gpu_time == std::chrono::microseconds(5 + k));
    CHECK(task.kernels[0].samples == 10);
    CHECK(learned.warnings.empty());
    CHECK(learned.tasks[0].times.by_cupti);
}

TEST_CASE("Profile by CUPTI takes a kernel for its launch by either call's id", "[unit][trace]") {
    CuptiTrace trace;
    trace.launch("a", 20 * kMs).launch.correlations = {5, 6};  // the runtime's call is around it
    trace.launch("b", 21 * kMs).launch.correlations = {7, 0};
    trace.launch("c", 22 * kMs).launch.correlations = {0, 9};
    trace.kernel(6, 20 * kMs + kUs, 20 * kMs + 3 * kUs);
    trace.kernel(9, 22 * kMs + kUs, 22 * kMs + 5 * kUs);
    trace.kernel(7, 21 * kMs + kUs, 21 * kMs + 4 * kUs);  // out of order
    trace.kernel(50, 30 * kMs, 31 * kMs);                 // of nobody's launch
    const Trace parsed = trace.trace();
    const CuptiIntervals found = cupti_intervals(parsed);
    REQUIRE(found.launches.size() == 1);
    REQUIRE(found.launches[0].size() == 3);
    for (int k = 0; k < 3; ++k) {
        REQUIRE(found.launches[0][k].known);
        CHECK(found.launches[0][k].length_ns() == (2 + k) * kUs);
    }
    CHECK(found.launches[0][0].begin_ns == 20 * kMs + kUs);  // on our clock
    REQUIRE(found.others.size() == 1);
    CHECK(found.others[0].length_ns() == kMs);
}

TEST_CASE("Profile by CUPTI leaves out an instance that lacks a record, and says so",
          "[unit][trace]") {
    CuptiTrace trace;
    eager_frames(trace, 10, 18);  // of the fifth frame
    trace.builder.header.dropped_kernels = 1;
    const LearnedProfile learned = trace.learn();
    const TaskProfile& task = learned.profile.chains[0].tasks[0];
    CHECK(task.instances == 9);
    CHECK(task.kernels.at(0).samples == 9);
    CHECK(task.kernels.at(1).samples == 9);
    CHECK(learned.tasks[0].discarded_instances == 1);
    CHECK(has_warning(learned, "CUPTI dropped 1 kernels' records"));
    CHECK(has_warning(learned, "1 of 10 instances have launches without a record"));
}

TEST_CASE("Profile by CUPTI leaves out an instance with a kernel that CUPTI could not time",
          "[unit][trace]") {
    CuptiTrace trace;
    eager_frames(trace, 10, 18);
    const auto untimed = [&](std::uint32_t id) -> TraceRecord& {
        TraceRecord& record = trace.builder.add(kCuptiThread, TraceKind::kKernelTime, 0);
        record.kernel = {};
        record.kernel.correlation = id;
        return record;
    };
    untimed(18);
    CHECK(trace.learn().tasks[0].discarded_instances == 1);
    // Beside a record that has times, and one that ends before it begins.
    untimed(23);
    TraceRecord& backwards = untimed(30);
    backwards.kernel.begin = kAhead + 2 * kMs;
    backwards.kernel.end = kAhead + kMs;
    const LearnedProfile learned = trace.learn();
    CHECK(learned.tasks[0].discarded_instances == 3);
    CHECK(learned.profile.chains[0].tasks[0].kernels.at(1).samples == 7);
    CHECK(has_warning(learned, "3 of 10 instances have launches without a record"));
}

TEST_CASE("Graph is not taken for an empty one where CUPTI could not time its kernels",
          "[unit][trace]") {
    CuptiTrace trace;
    trace.launch("(graph of 1 kernels, 1)", 20 * kMs, 1, abi::kTraceGraph);
    TraceRecord& record = trace.builder.add(kCuptiThread, TraceKind::kKernelTime, 0);
    record.kernel = {};
    record.kernel.correlation = trace.last_id;
    trace.clocks(40 * kMs);
    const Trace parsed = trace.trace();
    CHECK_FALSE(cupti_intervals(parsed).launches.at(0).at(0).known);
    CHECK(cupti_intervals(parsed).others.empty());
}

TEST_CASE("Profile by CUPTI without any record has nothing to say", "[unit][trace]") {
    CuptiTrace trace;
    for (int i = 1; i < 10; ++i) {
        trace.launch("layer", i * 20 * kMs);
        trace.wait(i * 20 * kMs + kUs, i * 20 * kMs + 9 * kUs);
    }
    const LearnedProfile learned = trace.learn();
    CHECK(learned.profile.chains[0].tasks[0].kernels.empty());
    CHECK(has_warning(learned, "launches without a record"));
}

TEST_CASE("Profile by CUPTI of a graph is its busy time, not its length", "[unit][trace]") {
    CuptiTrace trace;
    for (int i = 1; i <= 10; ++i) {
        const std::int64_t at_ns = i * 20 * kMs;
        trace.launch("(graph of 3 kernels, 1)", at_ns, 1, abi::kTraceGraph);
        trace.kernel(trace.last_id, at_ns + 30 * kUs, at_ns + 45 * kUs);
        trace.kernel(trace.last_id, at_ns + 10 * kUs, at_ns + 20 * kUs);
        trace.kernel(trace.last_id, at_ns + 35 * kUs, at_ns + 50 * kUs);
        trace.launch("(graph of 0 kernels, 2)", at_ns + 2 * kUs, 1, abi::kTraceGraph);
        trace.wait(at_ns + 3 * kUs, at_ns + 55 * kUs);
    }
    const LearnedProfile learned = trace.learn();
    const TaskProfile& task = learned.profile.chains[0].tasks[0];
    REQUIRE(task.kernels.size() == 2);
    CHECK(task.kernels[0].gpu_time == 30us);
    CHECK(task.kernels[1].gpu_time == 0us);  // known to be empty
    CHECK(task.instances == 10);
}

TEST_CASE("Profile by CUPTI of a forked task adds up to its busy time", "[unit][trace]") {
    CuptiTrace trace;
    for (int i = 1; i <= 10; ++i) {
        const std::int64_t at_ns = i * 20 * kMs;
        // One on the first stream, then four at a time, then one that joins them.
        trace.launch("head", at_ns, 11);
        trace.kernel(trace.last_id, at_ns, at_ns + 100 * kUs);
        for (int b = 0; b < 4; ++b) {
            trace.launch("group", at_ns + (b + 1) * kUs, static_cast<std::uint64_t>(20 + b));
            trace.kernel(trace.last_id, at_ns + (100 + b) * kUs, at_ns + (200 + b) * kUs);
        }
        trace.launch("tail", at_ns + 6 * kUs, 11);
        trace.kernel(trace.last_id, at_ns + 204 * kUs, at_ns + 250 * kUs);
        trace.wait(at_ns + 7 * kUs, at_ns + 260 * kUs);
    }
    const LearnedProfile learned = trace.learn();
    const TaskProfile& task = learned.profile.chains[0].tasks[0];
    REQUIRE(task.kernels.size() == 6);
    CHECK(busy_time(task) == 249us);
    CHECK(task.kernels[1].gpu_time == 100us);
    CHECK(task.kernels[2].gpu_time == 1us);
    CHECK(task.kernels[0].stream == 0);
    CHECK(task.kernels[1].stream == 1);
    CHECK(task.kernels[4].stream == 4);
    CHECK(task.kernels[5].stream == 0);
    const TaskTimes& times = learned.tasks[0].times;
    CHECK(times.sum == 546us);
    CHECK(times.on_side_streams == 400us);
    CHECK(times.streams == 5);
}

TEST_CASE("Profile takes a contended position's time from the same kernel elsewhere",
          "[unit][trace]") {
    CuptiTrace trace;
    std::strcpy(trace.builder.add(8, TraceKind::kThread, 0).name, "other");
    for (int i = 1; i <= 10; ++i) {
        const std::int64_t at_ns = i * 20 * kMs;
        trace.launch("layer", at_ns);
        trace.kernel(trace.last_id, at_ns, at_ns + 100 * kUs);
        trace.launch("layer", at_ns + kUs);  // always beside the other's
        trace.kernel(trace.last_id, at_ns + 100 * kUs, at_ns + 600 * kUs);
        trace.wait(at_ns + 2 * kUs, at_ns + 610 * kUs);
        trace.launch("theirs", at_ns + kUs, 5, 0, 8);
        trace.kernel(trace.last_id, at_ns + 101 * kUs, at_ns + 600 * kUs);
    }
    const TaskProfile task = trace.learn().profile.chains[0].tasks[0];
    REQUIRE(task.kernels.size() == 2);
    CHECK(task.kernels[0].gpu_time == 100us);
    CHECK(task.kernels[1].gpu_time == 100us);
}

}  // namespace
}  // namespace urgengo::trace
