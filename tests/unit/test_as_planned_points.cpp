// SPDX-License-Identifier: Apache-2.0
//
// A slow task without a profile goes on as planned, point after point, without asking
// (runtime/as_planned.cpp), in virtual time.
#include "tests/support/as_planned_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using AsPlannedPointsTest = AsPlannedFixture;

TEST_CASE("A task alone without a profile needs a mark now and then while they run at once",
          "[as_planned]") {
    AsPlannedPointsTest f(true, false);
    f.begin(f.thread_a, "tight");
    int marks = 0;
    auto between = 10us;
    const auto launch = [&](int launches, bool runs_at_once) {
        for (int i = 0; i < launches; ++i) {
            f.clock.advance(between);
            const std::size_t before = f.driver.marks.size();
            f.planned();
            marks += f.driver.marks.size() > before;
            if (runs_at_once || before > 0) f.driver.execute_marks(1);
        }
    };
    launch(26, true);
    CHECK(marks == 1);
    SECTION("but as usual while they are launched as fast as can be") {
        between = 1us;
        launch(50, true);
        CHECK(marks == 2);
    }
    SECTION("15 points are believed, 1 ms of launches each, and the next one is marked") {
        launch(799, true);
        CHECK(marks == 1);
        launch(1, true);
        CHECK(marks == 2);
        launch(799, false);
        CHECK(marks == 2);
        launch(1, false);
        CHECK(marks == 3);
        launch(25, false);  // that one did not run at once
        CHECK(marks == 4);
        launch(25, false);
        CHECK(marks == 5);
    }
}

TEST_CASE("Where a slow task without a profile is, is known within what it launched last",
          "[as_planned]") {
    AsPlannedPointsTest f(true, false);
    f.begin(f.thread_a, "tight");
    const auto launch = [&](int launches) {
        for (int i = 0; i < launches; ++i) {
            f.clock.advance(30us);  // unknown kernels count for 20
            f.planned();
            f.driver.execute_marks(1);
        }
    };
    launch(130);
    launch(100);  // points, each of which stands for fifty
    f.clock.advance(100us);
    f.rt().waits().event_recorded(f.thread_a, nullptr, kStreamA, exec::StreamFlavor::kLegacy, true);
    launch(1);  // is asked about, and comes behind what the log stands for
    const auto at = f.rt().progress().position("tight", "detect");
    REQUIRE(at);
    CHECK(at->at.position >= 229);  // that one, or the one before, which went some time before it
    CHECK(at->at.unexecuted <= 40us);
    CHECK(f.stats(0).tasks.launches == 231);
}

TEST_CASE("A slow task without a profile that goes on for long is known as well", "[as_planned]") {
    AsPlannedPointsTest f(true, false);
    f.begin(f.thread_a, "tight");
    const auto launch = [&](int launches, nanoseconds between = 30us) {
        int asked = 0;
        for (int i = 0; i < launches; ++i) {
            f.clock.advance(between);
            asked += !f.planned();
            f.driver.execute_marks(1);
        }
        return asked;
    };
    launch(130);  // and so it is slow
    // Points of 50 launches each.
    CHECK(launch(450) == 0);
    const auto at = f.rt().progress().position("tight", "detect");
    REQUIRE(at);
    CHECK(at->at.unexecuted <= 2ms);
    CHECK(at->at.unexecuted >= 0ms);
    CHECK(at->at.position >= 480);
    CHECK(at->at.position <= 580);
    SECTION("where a helper that joins it finds it, too") {
        const Launch l{kConv, 100, 256, kStreamA};
        const Grant g = f.rt().launches().before(f.thread_b, l);
        REQUIRE(g.task);
        f.rt().launches().after(f.thread_b, l, g, true);
        const auto found = f.rt().progress().position("tight", "detect");
        REQUIRE(found);
        CHECK(found->at.position >= 480);
        CHECK(f.stats(0).tasks.launches == 581);
        launch(100);
        CHECK(f.stats(0).tasks.launches == 681);
    }
    SECTION("until it is not slow any more") {
        int marks = 0;
        for (int i = 0; i < 150; ++i) {
            f.clock.advance(1us);
            const std::size_t before = f.driver.marks.size();
            f.planned();
            marks += f.driver.marks.size() > before;
        }
        CHECK(marks > 0);
        CHECK(f.stats(0).tasks.launches == 730);
    }
    SECTION("and counted when it has been waited for") {
        f.wait(f.thread_a, kStreamA);
        CHECK(f.stats(0).tasks.launches == 580);
        const auto found = f.rt().progress().position("tight", "detect");
        REQUIRE(found);
        CHECK(found->at.unexecuted == 0ms);
        CHECK(found->at.position == 580);
    }
    SECTION("where who comes reckons with what it launched last, not with all") {
        f.begin(f.thread_b, "loose");
        const auto before = f.clock.now();
        f.launch(f.thread_b, kStreamB);
        CHECK(f.clock.now() - before >= 400us);  // it was held
        CHECK(f.clock.now() - before <= 4ms);    // twice 1 ms and one, then that is overdue
    }
    SECTION("but not when a helper has launched since it was last asked") {
        f.rt().waits().event_recorded(f.thread_a, nullptr, kStreamA, exec::StreamFlavor::kLegacy,
                                      true);
        CHECK(launch(2) == 2);  // the first may be timed; from the second on it is allowed more
        for (int i = 0; i < 150; ++i) {
            f.clock.advance(1us);
            f.launch(f.thread_b, kStreamA);  // as fast as can be: there is a mark, not executed yet
        }
        CHECK(launch(120) > 0);
    }
}

TEST_CASE("A slow task is where its launches are while it goes on", "[as_planned]") {
    AsPlannedPointsTest f(true, false);
    f.begin(f.thread_a, "tight");
    for (int i = 1; i <= 420; ++i) {
        f.clock.advance(10us);  // unknown kernels count for 20
        f.planned();
        f.driver.execute_marks(1);
        if (i < 200) continue;
        const auto at = f.rt().progress().position("tight", "detect");
        REQUIRE(at);
        INFO(i);
        // Since the last point half of what was launched is thought to have executed.
        CHECK(at->at.position + 30 >= std::uint32_t(i));
        CHECK(at->at.position <= std::uint32_t(i));
    }
}

TEST_CASE("Nor is one that is slow believed for ever because its instances are short",
          "[as_planned]") {
    AsPlannedPointsTest f(true, false);
    std::size_t marks = 0;
    for (int instance = 0; instance < 40; ++instance) {
        f.begin(f.thread_a, "tight");
        for (int i = 0; i < 130; ++i) {  // one point each, once they are known to be short
            f.clock.advance(10us);
            f.planned();
            marks += f.driver.marks.size();
            f.driver.execute_marks(1);
        }
        f.wait(f.thread_a, kStreamA);
        if (instance == 0) CHECK(marks == 1);  // it is slow
    }
    CHECK(marks >= 2);
    CHECK(marks <= 4);
}
