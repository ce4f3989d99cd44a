// SPDX-License-Identifier: Apache-2.0
//
// A task that launches more slowly than the GPU executes, alone there: it needs hardly a mark
// (runtime/as_planned.cpp), in virtual time.
#include "tests/support/as_planned_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using Fixture = AsPlannedFixture;

TEST_CASE("A task alone that launches more slowly than the GPU executes needs no mark",
          "[as_planned]") {
    Fixture f;
    f.rt();
    f.clock.advance(101ms);  // somebody might have been here before
    f.begin(f.thread_a, "tight");
    const auto launch = [&](int launches, nanoseconds each) {
        for (int i = 0; i < launches; ++i) {
            f.clock.advance(each);
            f.planned();
        }
    };
    launch(12, 250us);  // kernels of 100 us
    CHECK(f.driver.marks.empty());
    const auto at = f.rt().progress().position("tight", "detect");
    REQUIRE(at);
    CHECK(at->at.unexecuted <= 200us);  // the two launches since
    CHECK(at->remaining == at->at.unexecuted + 800us);

    SECTION("When it launches faster, it is marked") {
        launch(14, 60us);
        CHECK(f.driver.marks.size() == 1);
    }
    SECTION("While its last mark is under way, it is marked") {
        launch(14, 60us);
        launch(5, 250us);
        CHECK(f.driver.marks.size() == 2);
    }
    SECTION("When that mark has executed, no more") {
        launch(14, 60us);
        f.driver.execute_marks(1);
        launch(5, 250us);
        CHECK(f.driver.marks.empty());
    }
    SECTION("Beside others, it is marked all the same") {
        f.begin(f.thread_b, "loose");
        f.launch(f.thread_b, kStreamB);
        launch(4, 250us);
        CHECK_FALSE(f.driver.marks.empty());
    }
}

TEST_CASE("A task alone whose last segment was launched slowly is asked about later",
          "[as_planned]") {
    Fixture f;
    const auto asked = [&](nanoseconds each) {
        int count = 0;
        for (int i = 0; i < 20; ++i) {
            f.clock.advance(each);
            count += !f.planned();
        }
        f.wait(f.thread_a, kStreamA);
        return count;
    };
    f.begin(f.thread_a, "tight");
    CHECK(asked(250us) == 2);  // its first, and at 0.5 ms; not at 1.5, as it is slow
    f.begin(f.thread_a, "tight");
    CHECK(asked(250us) == 1);  // its first
    CHECK(f.driver.marks.empty());
    f.begin(f.thread_a, "tight");
    CHECK(asked(110us) == 3);  // at 1 ms it is too fast, and so at 1.5
    CHECK(f.driver.marks.size() == 2);
    f.begin(f.thread_a, "tight");
    CHECK(asked(110us) >= 4);  // its first, and every 0.5 ms; its marks do not execute
    CHECK(f.stats(0).tasks.launches == 80);
}

TEST_CASE("A task alone is not taken for slow because it waits", "[as_planned]") {
    const bool has_profile = GENERATE(true, false);
    Fixture f(true, has_profile);
    const int launches = has_profile ? 8 : 26;
    f.begin(f.thread_a, "tight");
    for (int frame = 0; frame < 3; ++frame) {
        if (has_profile) f.begin(f.thread_a, "tight");
        for (int i = 0; i < launches; ++i) {
            f.clock.advance(1us);
            f.planned();
        }
        CHECK(f.driver.marks.size() == 1);  // in the middle, or before its last launch
        f.clock.advance(10ms);
        f.driver.execute_marks(1);
        f.wait(f.thread_a, kStreamA);
    }
}

TEST_CASE("What a slow task has launched is taken for executed without asking", "[as_planned]") {
    Fixture f;
    f.resolved.profile->chains[0].tasks[0] = profile_of("detect", 60, 100us, 1.0);
    f.resolved.profile->chains[0].tasks[0].segments = {{1ms, 60, 60, 60, "stream"}};
    f.begin(f.thread_a, "tight");
    const auto launch = [&](int launches, nanoseconds each) {
        int asked = 0;
        for (int i = 0; i < launches; ++i) {
            f.clock.advance(each);
            asked += !f.planned();
        }
        return asked;
    };
    launch(6, 250us);  // half of the run-ahead: it is slow
    CHECK(launch(30, 250us) == 0);
    const auto at = f.rt().progress().position("tight", "detect");
    REQUIRE(at);
    CHECK(at->at.position >= 25);  // seen last at the 25th
    CHECK(at->remaining == at->at.unexecuted + 24 * 100us);
    CHECK(f.stats(0).tasks.launches == 36);

    SECTION("but not what it launches faster") {
        launch(10, 60us);
        CHECK(f.driver.marks.size() == 1);
    }
    SECTION("nor when somebody has come, who reckons with it as ever") {
        f.begin(f.thread_b, "loose");
        f.launch(f.thread_b, kStreamB);
        CHECK(f.stats(1).tasks.holds == 1);
        CHECK(launch(1, 250us) == 1);
    }
    SECTION("nor what asks for something of its own") {
        launch(9, 250us);
        Launch urgent{kConv, 100, 256, kStreamA};
        urgent.asks_priority = true;
        CHECK_FALSE(f.launch_as_interposed(f.thread_a, urgent));
    }
    SECTION("nor what another run's is") {
        launch(9, 250us);
        f.rt().frames().task_end(f.thread_a);
        CHECK_FALSE(f.thread_a.line.as_planned.may_go_on);
        CHECK(f.thread_a.line.as_planned.left == 0);
    }
    SECTION("nor while its thread is busy with another stream") {
        launch(9, 250us);
        CHECK_FALSE(f.planned(kStreamB));  // where it would have gone on
        CHECK(f.stats(0).tasks.launches == 46);
    }
    SECTION("nor when another thread is at the task") {
        launch(9, 250us);
        f.rt().waits().implicit_sync_begins(f.thread_a);
        CHECK(launch(1, 250us) == 1);
        f.rt().waits().implicit_sync_ended(f.thread_a);
    }
}

TEST_CASE("Time before a long kernel is not taken for the time that it took", "[as_planned]") {
    Fixture f;
    f.resolved.profile->chains[0].tasks[0].kernels[3].gpu_time = 4ms;
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 3; ++i) f.planned();
    f.clock.advance(10ms);
    f.planned();
    f.clock.advance(10us);
    f.planned();
    CHECK(f.driver.marks.size() == 1);
    CHECK(f.rt().progress().position("tight", "detect")->at.position == 3);
}

TEST_CASE("Not for ever does a task alone go without a mark", "[as_planned]") {
    Fixture f;
    f.resolved.profile->chains[0].tasks[0] = profile_of("detect", 200, 100us, 1.0);
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 150; ++i) {
        f.clock.advance(250us);
        f.planned();
    }
    CHECK(f.driver.marks.empty());
    for (int i = 150; i < 160; ++i) {
        f.clock.advance(250us);
        f.planned();
    }
    CHECK(f.driver.marks.size() == 1);
}
