// SPDX-License-Identifier: Apache-2.0
//
// Instances and tasks by what a program or a config says: hints, ranges, kernels, names.
#include "tests/support/trace_frames.h"

namespace urgengo::trace {
namespace {

using namespace std::chrono_literals;
using abi::TraceWait;
using testing::TestKernel;
using testing::TraceBuilder;
using testing::TracedThread;

TEST_CASE("Instances are the hints', whatever repeats", "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 1, "det");
    launch_many(thread, "warm_up", 9);
    thread.wait();
    for (std::uint32_t frame = 0; frame < 12; ++frame) {
        thread.sleep(5 * kMs);
        thread.task_begin(0, frame + 1);
        for (int i = 0; i < 2; ++i) {
            thread.compute(70'000);
            launch_many(thread, "k", 3);
            if (i == 0) thread.wait();
        }
        thread.task_end(0, frame + 1);
        thread.wait();  // after the hint: still what closed it
    }
    const TaskInstances task = learn(builder, one_task({}));
    CHECK(task.boundaries == Boundaries::kKnown);
    REQUIRE(task.instances.size() == 12);
    CHECK(task.instances[5].segments.size() == 2);
    CHECK(task.instances[5].segments[0].cpu_ns == 70'000);
    CHECK(task.instances[5].segments[0].idle_ns == 0);
    CHECK(task.instances[5].segments[1].closed_by_name() == "stream");
    CHECK(task.num_launches == 72);  // the warm-up is of no task
}

TEST_CASE("Instances follow hints from another thread than the launches", "[unit][trace]") {
    TraceBuilder builder;
    TracedThread middleware(builder, 1, "executor"), worker(builder, 2, "worker");
    for (std::uint32_t frame = 0; frame < 10; ++frame) {
        middleware.sleep_until((frame + 1) * 20 * kMs);
        worker.sleep_until(middleware.now_ns());
        middleware.instance_begin(0, frame);
        for (int i = 0; i < 3; ++i) {
            worker.launch({"k"}, 0, frame);
            worker.wait();
        }
    }
    const TaskInstances task = learn(builder, one_task({}));
    CHECK(task.boundaries == Boundaries::kKnown);
    REQUIRE(task.instances.size() == 10);
    CHECK(task.instances[5].segments.size() == 3);
}

TEST_CASE("Instances of a hint have what helper threads launched for it", "[unit][trace]") {
    TraceBuilder builder;
    TracedThread main(builder, 1, "main"), helper(builder, 2, "helper");
    for (std::uint32_t frame = 0; frame < 10; ++frame) {
        main.sleep_until((frame + 1) * 20 * kMs);
        main.task_begin(0, 100 + frame);
        main.instance_begin(0, frame);
        main.launch({"a"}, 0, frame);
        helper.sleep_until(main.now_ns());
        helper.launch({"b"}, 0, frame);
        helper.wait();
        main.wait();
        main.task_end(0, 100 + frame);
    }
    const TaskInstances task = learn(builder, one_task({}));
    REQUIRE(task.instances.size() == 10);
    CHECK(task.instances[5].num_launches == 2);
    CHECK(task.instances[5].segments.size() == 2);
}

TEST_CASE("Instances are a task's NVTX ranges", "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 1, "main");
    for (int frame = 0; frame < 12; ++frame) {
        thread.push("frame");
        thread.push("detect:" + std::to_string(frame));
        launch_many(thread, "k", 4);
        thread.wait();
        thread.push("nms");
        launch_many(thread, "k", 2);
        thread.wait();
        thread.pop();
        thread.pop();
        thread.push("track");
        launch_many(thread, "k", 1);
        thread.wait();
        thread.pop();
        thread.pop();
    }
    const config::Config config = two_tasks({"", "", "detect:*"}, {"", "ma*", "track"});
    const TaskInstances detect = learn(builder, config, 0), track = learn(builder, config, 1);
    CHECK(detect.boundaries == Boundaries::kKnown);
    REQUIRE(detect.instances.size() == 12);
    CHECK(detect.instances[3].num_launches == 6);
    CHECK(detect.instances[3].segments.size() == 2);
    REQUIRE(track.instances.size() == 12);
    CHECK(track.instances[3].num_launches == 1);
}

TEST_CASE("Tasks of one thread are told by the kernels that begin them", "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 1, "main");
    for (int frame = 0; frame < 20; ++frame) {
        thread.sleep_until((frame + 1) * 20 * kMs);
        thread.launch({"detect_in", 10, 64});
        launch_many(thread, "gemm", 3);
        thread.wait();
        launch_many(thread, "gemm", 2);
        thread.wait();
        thread.launch({"track_in", 10, 64});
        launch_many(thread, "gemm", 5);
        if (frame % 2) thread.wait();  // and even where nothing waits in between
    }
    config::Task detect, track, other;
    detect.kernels = {{"detect_*", 10, 64}};
    track.kernels = {{"track_*", 0, 0}};
    const config::Config config = two_tasks(detect, track);
    const TaskInstances first = learn(builder, config, 0), second = learn(builder, config, 1);
    REQUIRE(first.instances.size() == 20);
    CHECK(first.instances[6].segments.size() == 2);
    CHECK(first.instances[6].num_launches == 6);
    CHECK(second.num_launches == 120);
    // A pattern of another size begins nothing.
    detect.kernels = {{"detect_*", 11, 0}};
    CHECK(learn(builder, two_tasks(detect, track), 0).num_launches == 0);
}

TEST_CASE("Instances of a pool of threads that share a name are learned together",
          "[unit][trace]") {
    TraceBuilder builder;
    std::vector<TracedThread> pool;
    for (std::uint32_t i = 0; i < 3; ++i) pool.emplace_back(builder, i + 1, "pool");
    for (int frame = 0; frame < 45; ++frame) {
        TracedThread& thread = pool[static_cast<std::size_t>(frame % 3)];
        thread.sleep_until((frame + 1) * 20 * kMs);
        detector_frame(thread);
    }
    const TaskInstances task = learn(builder, one_task({"", "po*"}));
    REQUIRE(task.instances.size() == 45);
    CHECK(task.period_ns == 20 * kMs);
    for (std::size_t i = 1; i < 45; ++i) {
        CHECK(task.instances[i].begin_ns > task.instances[i - 1].begin_ns);
    }
}

TEST_CASE("Threads are matched by the name that they have at the launch", "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 1, "first");
    launch_many(thread, "k", 3);
    thread.wait();
    thread.rename("second");
    launch_many(thread, "k", 4);
    thread.wait();
    const config::Config config = two_tasks({"", "first"}, {"", "second"});
    CHECK(learn(builder, config, 0).num_launches == 3);
    CHECK(learn(builder, config, 1).num_launches == 4);
}

TEST_CASE("What the runtime knew goes before the thread's name", "[unit][trace]") {
    TraceBuilder builder;
    TracedThread thread(builder, 1, "first");
    launch_many(thread, "k", 3, 1);
    const config::Config config = two_tasks({"", "first"}, {"", "second"});
    CHECK(learn(builder, config, 0).num_launches == 0);
    CHECK(learn(builder, config, 1).num_launches == 3);
}

}  // namespace
}  // namespace urgengo::trace
