// SPDX-License-Identifier: Apache-2.0
//
// Which launches are of which task, and which of one frame: with hints, ranges, patterns and
#include "tools/trace/instances.h"

#include "tests/support/trace_frames.h"

namespace urgengo::trace {
namespace {

using namespace std::chrono_literals;
using abi::TraceWait;
using testing::TestKernel;
using testing::TraceBuilder;
using testing::TracedThread;

TEST_CASE("Segment has the CPU time before it, without waits, and the time off the CPU",
          "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 1, "det");
    for (int i = 0; i < 2; ++i) {
        thread.sleep(5 * kMs);
        thread.compute(400'000);
        thread.wait(TraceWait::kCopy, i == 0, true);  // a copy of its own, spinning
        thread.compute(100'000);
        launch_many(thread, "k", 4);
        thread.wait(TraceWait::kEvent);
    }
    const auto trace = parse_trace(builder.bytes(), "a.trace");
    REQUIRE(trace);
    const auto segments = find_segments(*trace, TaskMatcher(one_task({"", "det"}), *trace))[0];
    REQUIRE(segments.size() == 2);
    CHECK(segments[1].num_launches == 4);
    CHECK(segments[1].first_launch == 4);
    CHECK(segments[1].closed_by_name() == "event");
    CHECK(segments[1].cpu_ns == 500'000);
    CHECK(segments[1].idle_ns == 5 * kMs);
    CHECK(segments[1].gap_ns == 5'500'000);
}

TEST_CASE("Segment's CPU time is right when the 32 bits of it wrap", "[unit][trace]") {
    TraceBuilder builder;
    builder.add(1, TraceKind::kLaunch, 0);
    abi::TraceRecord& wait = builder.add(1, TraceKind::kWait, 1000);
    wait.flags = abi::kTraceCovers;
    wait.wait.end_ns = 2000;
    wait.cpu_us = 0xfffffff0;
    abi::TraceRecord& launch = builder.add(1, TraceKind::kLaunch, 2000 + 50'000);
    launch.cpu_us = 0x10;
    const auto trace = parse_trace(builder.bytes(), "a.trace");
    REQUIRE(trace);
    const auto segments = find_segments(*trace, TaskMatcher({}, *trace))[0];
    REQUIRE(segments.size() == 2);
    CHECK(segments[1].cpu_ns == 32'000);
    CHECK(segments[1].idle_ns == 18'000);
}

TEST_CASE("Instances begin where the thread waits for its frame", "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 1, "det");
    for (int frame = 0; frame < 30; ++frame) {
        thread.sleep_until((frame + 1) * 20 * kMs);
        detector_frame(thread);
    }
    const TaskInstances task = learn(builder, one_task({"", "det"}));
    CHECK(task.boundaries == Boundaries::kRepeating);
    REQUIRE(task.instances.size() == 30);
    for (const Instance& instance : task.instances) {
        REQUIRE(instance.segments.size() == 3);
        CHECK(instance.segments[0].num_launches == 2);
        CHECK(instance.segments[2].closed_by_name() == "stream");
    }
    CHECK(task.period_ns == 20 * kMs);
    CHECK(task.start_up_launches == 0);
    CHECK(task.irregular_launches == 0);
}

TEST_CASE("Instances begin where the thread is off the CPU, however long it computes elsewhere",
          "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 1, "det");
    for (int frame = 0; frame < 30; ++frame) {
        thread.sleep(4 * kMs);
        launch_many(thread, "backbone", 8);
        thread.wait(TraceWait::kEvent);
        thread.compute(14 * kMs);
        launch_many(thread, "head", 3);
        thread.wait();
    }
    const TaskInstances task = learn(builder, one_task({"", "det"}));
    REQUIRE(task.instances.size() == 30);
    CHECK(task.instances[9].segments[0].num_launches == 8);
}

TEST_CASE("Instances begin after the longest gap when the thread polls for its frame",
          "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 1, "det");
    for (int frame = 0; frame < 30; ++frame) {
        thread.compute(std::max<std::int64_t>(0, (frame + 1) * 20 * kMs - thread.now_ns()));
        detector_frame(thread);
    }
    const TaskInstances task = learn(builder, one_task({"", "det"}));
    CHECK(task.boundaries == Boundaries::kRepeating);
    REQUIRE(task.instances.size() == 30);
    CHECK(task.instances[4].segments[0].num_launches == 2);
}

TEST_CASE("Instances leave out building, tuning and warming up", "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 1, "det");
    for (int i = 0; i < 40; ++i) {  // weights, and candidates of an autotuner
        launch_many(thread, "fill" + std::to_string(i % 7), 1 + i % 5);
        thread.wait(i % 3 == 0 ? TraceWait::kContext : TraceWait::kEvent);
    }
    for (int i = 0; i < 4; ++i) detector_frame(thread);  // warm-up, back to back
    const std::int64_t begin = thread.now_ns();
    for (int frame = 0; frame < 40; ++frame) {
        thread.sleep_until(begin + (frame + 1) * 20 * kMs);
        detector_frame(thread);
    }
    const TaskInstances task = learn(builder, one_task({"", "det"}));
    std::size_t start_up = 4 * 13;
    for (int i = 0; i < 40; ++i) start_up += static_cast<std::size_t>(1 + i % 5);
    // The last one of the warm-up is followed by a pause like all others.
    CHECK(task.instances.size() == 41);
    CHECK(task.start_up_launches == start_up - 13);
    CHECK(task.period_ns == 20 * kMs);
}

TEST_CASE("Instances are frames, not the many weights of a network that were made before",
          "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 1, "det");
    for (int weight = 0; weight < 1500; ++weight) {  // far more of them than frames
        launch_many(thread, "normal", 2);
        thread.wait();
    }
    for (int frame = 0; frame < 60; ++frame) {
        thread.sleep(18 * kMs);
        launch_many(thread, "conv", 30);
        thread.wait();
    }
    const TaskInstances found = learn(builder, one_task({"t", "det"}));
    CHECK(found.instances.size() >= 58);
    CHECK(found.instances.size() <= 60);
    CHECK(launch_counts(found) == std::vector<std::size_t>(found.instances.size(), 30));
    CHECK(found.start_up_launches >= 3000);
}

TEST_CASE("Instances are not shifted by an irregular one", "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 1, "det");
    for (int frame = 0; frame < 60; ++frame) {
        thread.sleep_until((frame + 1) * 20 * kMs);
        detector_frame(thread);
        if (frame % 20 != 13) continue;
        launch_many(thread, "save_a_map", 5);
        thread.wait(TraceWait::kContext);
    }
    const TaskInstances task = learn(builder, one_task({"", "det"}));
    REQUIRE(task.instances.size() == 60);
    for (const Instance& instance : task.instances) {
        CHECK(instance.segments[0].num_launches == 2);
        CHECK(instance.num_launches == 13);
    }
    CHECK(task.irregular_launches == 15);
}

TEST_CASE("Instances are found although launch counts and sizes vary", "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 1, "det");
    std::mt19937 random(7);
    for (int frame = 0; frame < 50; ++frame) {
        thread.sleep_until((frame + 1) * 20 * kMs);
        thread.launch({"voxelize", 100 + static_cast<std::uint32_t>(random() % 400), 256});
        thread.wait(TraceWait::kCopy);
        launch_many(thread, "refine", 1 + static_cast<int>(random() % 9));
        thread.wait();
    }
    const TaskInstances task = learn(builder, one_task({"", "det"}));
    CHECK(task.boundaries == Boundaries::kRepeating);
    REQUIRE(task.instances.size() == 50);
    CHECK(task.instances[20].segments.size() == 2);
    CHECK(task.instances[20].segments[0].closed_by_name() == "copy");
}

TEST_CASE("Instances of equal segments are told by the chain's period", "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 1, "det");
    for (int frame = 0; frame < 30; ++frame) {
        thread.sleep_until((frame + 1) * 20 * kMs);
        for (int i = 0; i < 4; ++i) {
            launch_many(thread, "k", 3);
            thread.wait();
        }
    }
    SECTION("with it") {
        const TaskInstances task = learn(builder, one_task({"", "det"}));
        CHECK(task.boundaries == Boundaries::kBursts);
        REQUIRE(task.instances.size() == 30);
        CHECK(task.instances[9].segments.size() == 4);
    }
    SECTION("not by one that the segments have themselves") {
        const TaskInstances task = learn(builder, one_task({"", "det"}, 150us));
        CHECK(task.boundaries == Boundaries::kRepeating);
        CHECK(task.instances.size() > 100);
    }
}

TEST_CASE("Instances of a long unit are not taken for many short ones", "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 1, "det");
    for (int frame = 0; frame < 12; ++frame) {
        thread.sleep_until((frame + 1) * 20 * kMs);
        for (int i = 0; i < 29; ++i) {
            launch_many(thread, "layer", 1);
            thread.wait();
        }
        launch_many(thread, "head", 2);
        thread.wait();
    }
    const TaskInstances task = learn(builder, one_task({"", "det"}));
    CHECK(task.boundaries == Boundaries::kRepeating);
    REQUIRE(task.instances.size() == 12);
    CHECK(task.instances[3].segments.size() == 30);
}

TEST_CASE("Instances are bursts between idle gaps when nothing repeats", "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 1, "det");
    std::mt19937 random(11);
    std::vector<std::size_t> counts;
    for (int frame = 0; frame < 40; ++frame) {
        thread.sleep_until((frame + 1) * 20 * kMs);
        std::size_t count = 0;
        const int segments = 1 + static_cast<int>(random() % 6);
        for (int i = 0; i < segments; ++i) {
            const int launches = 1 + static_cast<int>(random() % 5);
            launch_many(thread, "k" + std::to_string(random() % 9), launches);
            thread.wait(random() % 2 ? TraceWait::kStream : TraceWait::kEvent);
            thread.sleep(60'000);
            count += static_cast<std::size_t>(launches);
        }
        counts.push_back(count);
    }
    const TaskInstances task = learn(builder, one_task({"", "det"}));
    CHECK(task.boundaries == Boundaries::kBursts);
    CHECK(task.instances.size() >= 38);  // one at either end may count as start-up
    CHECK(task.period_ns == 20 * kMs);
    const auto found = launch_counts(task);
    CHECK(std::search(counts.begin(), counts.end(), found.begin(), found.end()) != counts.end());
}

TEST_CASE("Instances are not found in a thread that only ever runs on", "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 1, "det");
    std::mt19937 random(3);
    for (int i = 0; i < 60; ++i) {
        launch_many(thread, "k" + std::to_string(random() % 50),
                    1 + static_cast<int>(random() % 7));
        thread.wait();
    }
    const TaskInstances task = learn(builder, one_task({"", "det"}));
    CHECK(task.boundaries == Boundaries::kNone);
}

TEST_CASE("Instances of a thread that never waits end where it launches nothing", "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 1, "det");
    for (int frame = 0; frame < 20; ++frame) {
        thread.sleep_until((frame + 1) * 20 * kMs);
        launch_many(thread, "k", 6);
    }
    const TaskInstances task = learn(builder, one_task({"", "det"}));
    REQUIRE(task.instances.size() == 20);
    CHECK(task.instances[7].num_launches == 6);
    CHECK(task.instances[7].segments[0].closed_by_name() == "none");
}

}  // namespace
}  // namespace urgengo::trace
