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

TEST_CASE("Nothing goes unasked after a change, or by another thread",
          "[runtime][planned_launches]") {
    PlannedLaunchesTest f;
    CHECK_FALSE(f.planned.goes(f.thread_b, kNext));
    f.common().governor.tasks().changed();
    CHECK_FALSE(f.planned.goes(f.thread_a, kNext));
}
