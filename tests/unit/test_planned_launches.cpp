// SPDX-License-Identifier: Apache-2.0
//
// Which launches need no asking (test_as_planned.cpp has their whole life).
#include "host/runtime/planned_launches.h"

#include "host/runtime/as_planned.h"
#include "tests/support/rooms_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

const Launch kNext{kConv, 100, 256, kStreamA};

/// Thread a has made the first launch of its frame, which others may follow unasked.
struct PlannedLaunchesTest : RoomsFixture {
    PlannedLaunchesTest() {
        begin_frame(thread_a, "tight");
        launch_on(thread_a, kStreamA);
    }
};

}  // namespace

TEST_CASE("The plan's next launch needs no asking, and says what it takes",
          "[runtime][planned_launches]") {
    PlannedLaunchesTest f;
    REQUIRE(f.planned.goes(f.thread_a, kNext));
    CHECK(f.tight().slot->head_utilization_ppm == 1'000'000);
    runtime::went_as_planned(f.thread_a.line);
    CHECK(f.tight().slot->launched_ns == std::chrono::nanoseconds(200us).count());
    CHECK(f.tight().unasked.uncounted(*f.tight().slot) == 1);
}

TEST_CASE("Another one is asked about, and so are those after it", "[runtime][planned_launches]") {
    PlannedLaunchesTest f;
    Launch other = kNext;
    SECTION("of another size") {
        other.grid_blocks = 7;
    }
    SECTION("at a priority of its own") {
        other.asks_priority = true;
    }
    SECTION("on another stream") {
        other.stream = kStreamB;
    }
    CHECK_FALSE(f.planned.goes(f.thread_a, other));
    CHECK_FALSE(f.planned.goes(f.thread_a, kNext));
}

namespace {

/// The same of a frame that is not scheduled.
struct ObservedLaunchesTest : PlannedLaunchesTest {
    ObservedLaunchesTest() {
        frames.task_end(thread_a);
        tight().chain->allowed = config::Mode::kObserve;
        begin_frame(thread_a, "tight");
        REQUIRE(tight().run.observed);
        CHECK_FALSE(planned.goes(thread_a, kNext));
        REQUIRE_FALSE(launch_on(thread_a, kStreamA).scheduled);
    }
    bool launch_unasked() {
        if (!planned.goes(thread_a, kNext)) return false;
        runtime::went_as_planned(thread_a.line);
        return true;
    }
    void count() {
        REQUIRE(runs.take(thread_a, tight()));
        runs.release(thread_a);
    }
};

}  // namespace

TEST_CASE("Of a run that is not scheduled none is asked about that is as planned",
          "[runtime][planned_launches]") {
    ObservedLaunchesTest f;
    runtime::TaskState& task = f.tight();
    const std::int64_t launched_ns = task.slot->launched_ns;
    const std::uint32_t before = task.num_as_planned();
    const std::uint64_t scheduled = task.counters.scheduled, launches = task.counters.launches;
    const std::size_t left = task.tracker.segment_end() - 1;
    REQUIRE(left > 1);
    for (std::size_t i = 0; i < left; ++i) REQUIRE(f.launch_unasked());
    CHECK_FALSE(f.launch_unasked());
    CHECK(task.num_as_planned() == before);
    CHECK(task.slot->launched_ns == launched_ns);
    f.count();
    CHECK(task.run.position == task.tracker.segment_end());
    CHECK(task.tracker.fits());
    CHECK(task.slot->launched_ns == launched_ns);
    CHECK(task.counters.launches == launches + left);
    CHECK(task.counters.scheduled == scheduled);
    CHECK(task.num_as_planned() == before);
}

TEST_CASE("What changes of others is nothing to a run that is not scheduled",
          "[runtime][planned_launches]") {
    ObservedLaunchesTest f;
    REQUIRE(f.launch_unasked());
    f.common().governor.tasks().changed();
    SECTION("so it goes on") {
        REQUIRE(f.launch_unasked());
        f.count();
        CHECK(f.tight().run.position == 3);
    }
    SECTION("but where a module is unloaded") {
        f.common().kernels.forget();
        CHECK_FALSE(f.launch_unasked());
    }
    SECTION("but where a capture has begun") {
        f.common().streams.capture_begins(kStreamA, exec::StreamFlavor::kLegacy);
        CHECK_FALSE(f.launch_unasked());
    }
    SECTION("or its frame has ended") {
        f.frames.task_end(f.thread_a);
        CHECK_FALSE(f.launch_unasked());
        SECTION("and another has begun") {
            f.begin_frame(f.thread_a, "tight");
            CHECK_FALSE(f.launch_unasked());
        }
    }
    SECTION("or its chain is switched off") {
        f.tight().chain->allowed = config::Mode::kOff;
        CHECK_FALSE(f.launch_unasked());
    }
}

TEST_CASE("Nothing goes unasked of a run that another thread has ended, and begun anew",
          "[runtime][planned_launches]") {
    ObservedLaunchesTest f;
    runtime::TaskState& task = f.tight();
    REQUIRE(f.launch_unasked());
    task.tracked.hinted = false;
    f.runs.end_abandoned(f.thread_b, task, f.clock.now() + 1601ms);
    REQUIRE(f.runs.claim(f.thread_b, task));
    f.runs.begin(f.thread_b, task, f.clock.now(), f.clock.now(), false);
    CHECK_FALSE(f.launch_unasked());
}

TEST_CASE("Nothing goes unasked after a change, or by another thread",
          "[runtime][planned_launches]") {
    PlannedLaunchesTest f;
    CHECK_FALSE(f.planned.goes(f.thread_b, kNext));
    f.common().governor.tasks().changed();
    CHECK_FALSE(f.planned.goes(f.thread_a, kNext));
}
