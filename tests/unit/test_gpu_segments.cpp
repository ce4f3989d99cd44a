// SPDX-License-Identifier: Apache-2.0
//
// A task on the GPU, its marks, and launches that went unasked.
#include "host/runtime/gpu_segments.h"

#include "tests/support/common_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

/// The test has taken the task `tight`, whose kernels take 100 us; two of them are marked.
struct GpuSegmentsTest : CommonFixture {
    runtime::GpuSegments segments{common()};
    runtime::TaskState& task = tight();

    GpuSegmentsTest() {
        task.tracked.stream = kStreamA;
        loose_is_there();  // else marks are seldom
    }
    void loose_is_there() { ++common().page().on_gpu; }
    void launch() {
        task.tracker.launch({});
        ++task.run.position;
        task.work.launched += 100us;
        task.slot->launched_ns = task.work.launched.count();
        task.log.launched(100us, {.time = clock.now(), .position = task.run.position - 1});
        segments.launched(task, 100us, clock.now());
    }
};

}  // namespace

TEST_CASE("A task is on the GPU from enter() to leave()", "[runtime][gpu_segments]") {
    GpuSegmentsTest f;
    REQUIRE(f.segments.enter(f.task, f.clock.now()));
    CHECK(f.task.run.on_gpu);
    CHECK(f.task.slot->state == abi::TaskState::kGpu);
    CHECK(f.common().page().on_gpu == 2);
    f.segments.leave(f.task, true);
    CHECK_FALSE(f.task.run.on_gpu);
    CHECK(f.task.slot->state == abi::TaskState::kCpu);
    CHECK(f.common().page().on_gpu == 1);
    f.segments.leave(f.task, true);  // once
    CHECK(f.common().page().on_gpu == 1);
}

TEST_CASE("A mark is due behind so much work, and is emitted where nothing is captured",
          "[runtime][gpu_segments]") {
    GpuSegmentsTest f;
    REQUIRE(f.segments.enter(f.task, f.clock.now()));
    f.launch();
    CHECK_FALSE(f.segments.mark_is_due(f.task, f.clock.now()));
    f.launch();
    REQUIRE(f.segments.mark_is_due(f.task, f.clock.now()));
    SECTION("so it is emitted") {
        f.segments.emit_mark(f.task, f.clock.now());
        REQUIRE(f.driver.marks.size() == 1);
        CHECK(f.driver.marks[0].word0 >> 32 == 2);
        CHECK_FALSE(f.segments.mark_is_due(f.task, f.clock.now()));
    }
    SECTION("but not into a graph") {
        f.common().streams.capture_begins(kStreamA, exec::StreamFlavor::kLegacy);
        f.driver.capturing = kStreamA;
        f.segments.emit_mark(f.task, f.clock.now());
        CHECK(f.driver.marks.empty());
        f.driver.capturing = nullptr;
    }
}

TEST_CASE("What a task has launched is over when it leaves the GPU idle",
          "[runtime][gpu_segments]") {
    const bool idle = GENERATE(true, false);
    GpuSegmentsTest f;
    REQUIRE(f.segments.enter(f.task, f.clock.now()));
    f.launch();
    f.segments.leave(f.task, idle);
    CHECK(f.task.executed() == (idle ? 100us : 0us));
    CHECK(f.task.work.marked == (idle ? 100us : 0us));
}

TEST_CASE("Launches that went unasked are counted once", "[runtime][gpu_segments]") {
    GpuSegmentsTest f;
    REQUIRE(f.segments.enter(f.task, f.clock.now()));
    f.launch();
    f.task.slot->as_planned = 3;
    f.clock.advance(30us);
    for (int i = 0; i < 2; ++i) {
        f.segments.catch_up(f.task);
        CHECK(f.task.run.position == 4);
        CHECK(f.task.work.launched == 400us);
        CHECK(f.task.log.count() == 4);
        CHECK(f.task.unasked.uncounted(*f.task.slot) == 0);
    }
}
