// SPDX-License-Identifier: Apache-2.0
//
// Launches that need no asking (runtime/as_planned.cpp), in virtual time.
#include <random>
#include <vector>

#include "tests/support/as_planned_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using Fixture = AsPlannedFixture;

TEST_CASE("A task alone on the GPU is not asked about what its plan says", "[as_planned]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    CHECK_FALSE(f.planned());
    for (int i = 1; i < 5; ++i) CHECK(f.planned());
    CHECK(f.thread_a.line.as_planned.set_priority);
    CHECK(f.thread_a.line.as_planned.priority == -5);
    CHECK(f.stats(0).tasks.launches == 5);
    CHECK(f.stats(0).tasks.scheduled == 5);
    CHECK(f.driver.marks.empty());
    CHECK_FALSE(f.planned());  // half of the run-ahead has been launched: the mark
    REQUIRE(f.driver.marks.size() == 1);
    CHECK(f.driver.marks[0].word0 >> 32 == 5);
    f.wait(f.thread_a, kStreamA);
    CHECK_FALSE(f.planned());  // a new segment
    CHECK(f.stats(0).tasks.launches == 7);
}

TEST_CASE("A task is asked about everything again", "[as_planned]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    f.planned();
    REQUIRE(f.planned());

    SECTION("when somebody more urgent comes to the GPU") {
        f.begin(f.thread_b, "loose", 90ms);
        f.launch(f.thread_b, kStreamB);
        CHECK_FALSE(f.planned());
        CHECK(f.stats(0).tasks.holds == 1);  // until they are overdue
    }
    SECTION("when somebody less urgent comes to the GPU, once") {
        f.begin(f.thread_b, "loose");
        f.launch(f.thread_b, kStreamB);
        CHECK_FALSE(f.planned());
        CHECK(f.stats(0).tasks.holds == 0);
        CHECK(f.planned());
    }
    SECTION("among others, after a pause in which they stopped reckoning with it") {
        f.begin(f.thread_b, "loose");
        f.launch(f.thread_b, kStreamB);
        f.planned();
        REQUIRE(f.planned());
        f.clock.advance(201us);
        CHECK_FALSE(f.planned());
    }
    SECTION("when it launches another kernel") {
        CHECK_FALSE(f.launch_as_interposed(f.thread_a, {kOther, 100, 256, kStreamA}));
        CHECK_FALSE(f.planned());  // that first launch counted as a wait for all, which ended
        CHECK(f.planned());
    }
    SECTION("when it launches the kernel in another size") {
        CHECK_FALSE(f.launch_as_interposed(f.thread_a, {kConv, 101, 256, kStreamA}));
        CHECK_FALSE(f.launch_as_interposed(f.thread_a, {kConv, 100, 128, kStreamA}));
    }
    SECTION("on another stream") {
        CHECK_FALSE(f.planned(kStreamB));
        CHECK_FALSE(f.launch_as_interposed(
            f.thread_a, {kConv, 100, 256, kStreamB, exec::StreamFlavor::kPerThread}));
    }
    SECTION("when the launch asks for a priority, or depends on the last") {
        Launch launch{kConv, 100, 256, kStreamA};
        launch.asks_priority = true;
        CHECK_FALSE(f.launch_as_interposed(f.thread_a, launch));
        CHECK_FALSE(f.planned());  // the answer to that one is not the answer to all
        CHECK(f.planned());
        launch.asks_priority = false;
        launch.depends_on_previous = true;
        CHECK_FALSE(f.launch_as_interposed(f.thread_a, launch));
    }
    SECTION("behind an event that takes the time") {
        f.rt().waits().event_recorded(f.thread_a, reinterpret_cast<CUevent>(0xe), kStreamA,
                                      exec::StreamFlavor::kLegacy, true);
        CHECK_FALSE(f.planned());
    }
    SECTION("during a capture") {
        f.rt().streams().capture_begins(kStreamA, exec::StreamFlavor::kLegacy);
        f.driver.capturing = kStreamA;
        CHECK_FALSE(f.planned());
        f.driver.capturing = nullptr;
        f.rt().streams().capture_ended(kStreamA, exec::StreamFlavor::kLegacy);
        CHECK(f.stats(0).tasks.launches == 2);
    }
    SECTION("when UrgenGo is switched off") {
        f.rt().steering().set_mode(config::Mode::kOff);
        CHECK_FALSE(f.planned());
    }
    SECTION("when a module was unloaded") {
        f.rt().contexts().forget_names();
        CHECK_FALSE(f.planned());
    }
    SECTION("in another instance") {
        f.rt().frames().task_end(f.thread_a);
        CHECK_FALSE(f.planned());
        CHECK(f.stats(0).tasks.launches == 2);  // that one was nobody's
        f.begin(f.thread_a, "tight");
        CHECK_FALSE(f.planned());
        CHECK(f.planned());
        CHECK(f.stats(0).tasks.launches == 4);
    }
}

TEST_CASE("After a call that makes another context current, a launch is asked about",
          "[as_planned]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    f.planned(nullptr);
    REQUIRE(f.planned(nullptr));
    f.driver.context = reinterpret_cast<CUcontext>(0x43);
    f.thread_a.line.ask_again();
    CHECK_FALSE(f.planned(nullptr));
}

TEST_CASE("Where there have been no others for a while, half of the run-ahead is marked at once",
          "[as_planned]") {
    Fixture f;
    f.resolved.config.scheduler.progress.mark_every = 100us;
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_b, kStreamB);
    f.begin(f.thread_a, "tight");
    f.planned();
    f.rt().frames().task_end(f.thread_b);
    f.driver.execute_marks(8);
    f.driver.marks.clear();
    const auto launched_until_marked = [&] {
        int launched = 0;
        for (; f.driver.marks.empty(); ++launched) f.planned();
        f.driver.execute_marks(8);
        f.driver.marks.clear();
        return launched;
    };
    launched_until_marked();
    CHECK(launched_until_marked() == 2);
    f.wait(f.thread_a, kStreamA);
    f.clock.advance(100'001us);
    f.begin(f.thread_a, "tight");
    launched_until_marked();
    CHECK(launched_until_marked() == 5);
}

TEST_CASE("A helper that joins finds the task where its owner has brought it", "[as_planned]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 4; ++i) f.planned();
    f.launch(f.thread_b, kStreamA);
    CHECK(f.stats(0).tasks.launches == 5);
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_b, kStreamB);
    f.planned();  // marked, now that somebody looks
    REQUIRE_FALSE(f.driver.marks.empty());
    CHECK(f.driver.marks.back().word0 >> 32 >= 5);
}

TEST_CASE("No run-ahead is launched as planned beyond what its bound allows", "[as_planned]") {
    Fixture f;
    f.resolved.config.scheduler.progress.mark_every = 10ms;
    f.begin(f.thread_a, "tight");
    int held = 0;
    f.clock.on_sleep = [&] {
        ++held;
        f.driver.execute_marks(1);
    };
    for (int i = 0; i < 10; ++i) f.planned();
    CHECK(held == 0);
    f.planned();
    CHECK(f.driver.marks.empty());  // launched: 1 ms, the bound
    f.planned();
    CHECK(held == 1);
}

TEST_CASE("A call that changes the context while a launch is under way costs one more question",
          "[as_planned]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    f.planned();
    const Launch launch{kConv, 100, 256, kStreamA};
    REQUIRE(f.rt().planned().goes(f.thread_a, launch));
    f.thread_a.line.ask_again();  // by a tool, inside the driver
    runtime::went_as_planned(f.thread_a.line);
    CHECK_FALSE(f.planned());
    CHECK(f.planned());
}

TEST_CASE("What was waited for is where the task is, however it was launched", "[as_planned]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 4; ++i) f.planned();
    f.wait(f.thread_a, kStreamA);
    auto at = f.rt().progress().position("tight", "detect");
    REQUIRE(at);
    CHECK(at->at.position == 4);
    CHECK(at->at.unexecuted == 0us);
    CHECK(at->remaining == 1600us);
    for (int i = 0; i < 3; ++i) f.planned();
    at = f.rt().progress().position("tight", "detect");
    REQUIRE(at);
    CHECK(at->at.position == 4);
    CHECK(at->at.unexecuted == 300us);
}

// What the GPU is told, and what is counted, is the same as if every launch had been asked about.
TEST_CASE("Not asking changes nothing", "[as_planned][property]") {
    struct Outcome {
        std::vector<std::uint64_t> marks;
        std::uint64_t launches = 0, scheduled = 0, resyncs = 0;
        int skipped = 0;
    };
    const bool has_profile = GENERATE(true, false), may_lead = GENERATE(true, false);
    const auto run = [=](std::uint32_t seed, bool may_skip) {
        Fixture f(may_skip, has_profile);
        if (may_lead) f.resolved.config.scheduler.run_ahead.alone = 4ms;
        f.rt();
        f.clock.advance(2s);
        std::mt19937 random(seed);
        const auto one_in = [&](unsigned n) { return random() % n == 0; };
        Outcome out;
        bool other_is_there = false;
        f.clock.on_sleep = [&] { f.driver.execute_marks(8); };
        for (int instance = 0; instance < 8; ++instance) {
            f.begin(f.thread_a, "tight");
            const int launches = 18 + static_cast<int>(random() % 4);
            const bool is_slow = one_in(2);
            for (int i = 0; i < launches; ++i) {
                f.clock.advance(is_slow ? 250us : 3us);
                const bool strange = one_in(16);
                Launch launch{strange ? kOther : kConv, 100, 256, one_in(32) ? kStreamB : kStreamA};
                launch.asks_priority = one_in(32);
                launch.depends_on_previous = one_in(128);
                out.skipped += f.launch_as_interposed(f.thread_a, launch);
                // Who comes to a slow one, and waits, sees that it stands still, and since when:
                // since it was last asked.
                if (one_in(24) && !is_slow) {
                    if (other_is_there) f.rt().frames().task_end(f.thread_b);
                    if (!other_is_there) f.begin(f.thread_b, "loose");
                    other_is_there = !other_is_there;
                    if (other_is_there) f.launch(f.thread_b, kStreamB);
                }
                for (const auto& mark : f.driver.marks)
                    if (out.marks.empty() || mark.word0 != out.marks.back())
                        out.marks.push_back(mark.word0);
                if (one_in(3)) f.driver.execute_marks(1);
            }
            f.clock.advance(3ms);          // for longer than estimated: they are not corrected
            f.wait(f.thread_a, kStreamB);  // else what went there is not over
            f.wait(f.thread_a, kStreamA);
            f.driver.execute_marks(8);
            f.rt().frames().task_end(f.thread_a);
            if (may_lead && !other_is_there) f.clock.advance(one_in(2) ? 2s : 2ms);
        }
        out.launches = f.stats(0).tasks.launches;
        out.scheduled = f.stats(0).tasks.scheduled;
        out.resyncs = f.stats(0).frames.resyncs;
        return out;
    };
    int skipped = 0;
    for (std::uint32_t seed = 1; seed <= 200; ++seed) {
        CAPTURE(seed);
        const Outcome asked = run(seed, false), not_asked = run(seed, true);
        CHECK(asked.marks == not_asked.marks);
        CHECK(asked.launches == not_asked.launches);
        CHECK(asked.scheduled == not_asked.scheduled);
        CHECK(asked.resyncs == not_asked.resyncs);
        skipped += not_asked.skipped;
    }
    CHECK(skipped > 1000);
}
