// SPDX-License-Identifier: Apache-2.0
//
// A launch that is asked about, without the rest of the runtime.
#include "host/runtime/launch_path.h"

#include "tests/support/rooms_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

TEST_CASE("A launch of no chain is granted untouched", "[runtime][launch_path]") {
    RoomsFixture f;
    const Grant grant = f.launch_on(f.thread_a, kStreamA);
    CHECK(grant.task == nullptr);
    CHECK_FALSE(grant.set_priority);
}

TEST_CASE("A launch of a task alone on the GPU goes at the highest priority",
          "[runtime][launch_path]") {
    RoomsFixture f;
    f.begin_frame(f.thread_a, "tight");
    const Grant grant = f.launch_on(f.thread_a, kStreamA);
    REQUIRE(grant.task == &f.tight());
    CHECK(grant.scheduled);
    CHECK(grant.estimate == 100us);
    CHECK(grant.priority == -5);
    CHECK(f.tight().run.position == 1);
    CHECK(f.tight().work.launched == 100us);
    CHECK(f.thread_a.at_task == nullptr);
}

TEST_CASE("A launch that failed was none", "[runtime][launch_path]") {
    RoomsFixture f;
    f.begin_frame(f.thread_a, "tight");
    f.launch_on(f.thread_a, kStreamA, false);
    CHECK(f.tight().run.position == 0);
    CHECK(f.tight().work.launched == 0us);
    CHECK(f.thread_a.at_task == nullptr);
}

TEST_CASE("A launch is held while a more urgent task has work on the GPU",
          "[runtime][launch_path]") {
    RoomsFixture f;
    f.begin_frame(f.thread_a, "tight");
    f.begin_frame(f.thread_b, "loose");
    f.launch_on(f.thread_a, kStreamA);
    f.launch_on(f.thread_b, kStreamB);
    CHECK(f.clock.num_sleeps > 0);
    CHECK(f.loose().counters.holds == 1);
    CHECK(f.loose().run.waited.held > 0us);
    CHECK(f.loose().taking.held_frame == nullptr);
}
