// SPDX-License-Identifier: Apache-2.0
//
// Launches that need no asking (runtime/as_planned.cpp), in virtual time.
#include <algorithm>
#include <random>
#include <vector>

#include "tests/support/runtime_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

const CUfunction kOther = reinterpret_cast<CUfunction>(0x20);

// The chains of RuntimeFixture, each with one segment of 20 kernels that a stream's wait closes; or
// without a profile.
struct Fixture : RuntimeFixture {
    explicit Fixture(bool skips = true, bool has_profile = true) {
        may_skip = skips;
        resolved.config.scheduler.mark_every = 250us;  // alone, half of the run-ahead: five kernels
        driver.names[kOther] = "other";
        if (!has_profile) resolved.profile->chains.clear();
        close_segments();
    }

    bool planned(CUstream stream = kStreamA) {
        return launch_as_interposed(thread_a, {kConv, 100, 256, stream});
    }
};

}  // namespace

TEST_CASE("A task alone on the GPU is not asked about what its plan says", "[as_planned]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    CHECK_FALSE(f.planned());
    for (int i = 1; i < 5; ++i) CHECK(f.planned());
    CHECK(f.thread_a.line.as_planned.set_priority);
    CHECK(f.thread_a.line.as_planned.priority == -5);
    CHECK(f.stats(0).launches == 5);
    CHECK(f.stats(0).scheduled == 5);
    CHECK(f.driver.marks.empty());
    CHECK_FALSE(f.planned());  // half of the run-ahead has been launched: the mark
    REQUIRE(f.driver.marks.size() == 1);
    CHECK(f.driver.marks[0].word0 >> 32 == 5);
    f.wait(f.thread_a, kStreamA);
    CHECK_FALSE(f.planned());  // a new segment
    CHECK(f.stats(0).launches == 7);
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
        CHECK(f.stats(0).holds == 1);  // until they are overdue
    }
    SECTION("when somebody less urgent comes to the GPU, once") {
        f.begin(f.thread_b, "loose");
        f.launch(f.thread_b, kStreamB);
        CHECK_FALSE(f.planned());
        CHECK(f.stats(0).holds == 0);
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
        f.rt().event_recorded(f.thread_a, reinterpret_cast<CUevent>(0xe), kStreamA,
                              exec::StreamFlavor::kLegacy, true);
        CHECK_FALSE(f.planned());
    }
    SECTION("during a capture") {
        f.rt().streams().capture_begins(kStreamA, exec::StreamFlavor::kLegacy);
        f.driver.capturing = kStreamA;
        CHECK_FALSE(f.planned());
        f.driver.capturing = nullptr;
        f.rt().streams().capture_ended(kStreamA, exec::StreamFlavor::kLegacy);
        CHECK(f.stats(0).launches == 2);
    }
    SECTION("when UrgenGo is switched off") {
        f.rt().set_mode(config::Mode::kOff);
        CHECK_FALSE(f.planned());
    }
    SECTION("when a module was unloaded") {
        f.rt().forget_names();
        CHECK_FALSE(f.planned());
    }
    SECTION("in another instance") {
        f.rt().task_end(f.thread_a);
        CHECK_FALSE(f.planned());
        CHECK(f.stats(0).launches == 2);  // that one was nobody's
        f.begin(f.thread_a, "tight");
        CHECK_FALSE(f.planned());
        CHECK(f.planned());
        CHECK(f.stats(0).launches == 4);
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
    f.resolved.config.scheduler.mark_every = 100us;
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_b, kStreamB);
    f.begin(f.thread_a, "tight");
    f.planned();
    f.rt().task_end(f.thread_b);
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
    CHECK(f.stats(0).launches == 5);
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_b, kStreamB);
    f.planned();  // marked, now that somebody looks
    REQUIRE_FALSE(f.driver.marks.empty());
    CHECK(f.driver.marks.back().word0 >> 32 >= 5);
}

TEST_CASE("No run-ahead is launched as planned beyond what its bound allows", "[as_planned]") {
    Fixture f;
    f.resolved.config.scheduler.mark_every = 10ms;
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
    const auto at = f.rt().position("tight", "detect");
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
    CHECK(f.stats(0).launches == 80);
}

TEST_CASE("A task alone without a profile needs a mark now and then while they run at once",
          "[as_planned]") {
    Fixture f(true, false);
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
    Fixture f(true, false);
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
    f.rt().event_recorded(f.thread_a, nullptr, kStreamA, exec::StreamFlavor::kLegacy, true);
    launch(1);  // is asked about, and comes behind what the log stands for
    const auto at = f.rt().position("tight", "detect");
    REQUIRE(at);
    CHECK(at->at.position >= 229);  // that one, or the one before, which went some time before it
    CHECK(at->at.unexecuted <= 40us);
    CHECK(f.stats(0).launches == 231);
}

TEST_CASE("A slow task without a profile that goes on for long is known as well", "[as_planned]") {
    Fixture f(true, false);
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
    const auto at = f.rt().position("tight", "detect");
    REQUIRE(at);
    CHECK(at->at.unexecuted <= 2ms);
    CHECK(at->at.unexecuted >= 0ms);
    CHECK(at->at.position >= 480);
    CHECK(at->at.position <= 580);
    SECTION("where a helper that joins it finds it, too") {
        const Launch l{kConv, 100, 256, kStreamA};
        const Grant g = f.rt().before_launch(f.thread_b, l);
        REQUIRE(g.task);
        f.rt().after_launch(f.thread_b, l, g, true);
        const auto found = f.rt().position("tight", "detect");
        REQUIRE(found);
        CHECK(found->at.position >= 480);
        CHECK(f.stats(0).launches == 581);
        launch(100);
        CHECK(f.stats(0).launches == 681);
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
        CHECK(f.stats(0).launches == 730);
    }
    SECTION("and counted when it has been waited for") {
        f.wait(f.thread_a, kStreamA);
        CHECK(f.stats(0).launches == 580);
        const auto found = f.rt().position("tight", "detect");
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
        f.rt().event_recorded(f.thread_a, nullptr, kStreamA, exec::StreamFlavor::kLegacy, true);
        CHECK(launch(2) == 2);  // the first may be timed; from the second on it is allowed more
        for (int i = 0; i < 150; ++i) {
            f.clock.advance(1us);
            f.launch(f.thread_b, kStreamA);  // as fast as can be: there is a mark, not executed yet
        }
        CHECK(launch(120) > 0);
    }
}

TEST_CASE("A slow task is where its launches are while it goes on", "[as_planned]") {
    Fixture f(true, false);
    f.begin(f.thread_a, "tight");
    for (int i = 1; i <= 420; ++i) {
        f.clock.advance(10us);  // unknown kernels count for 20
        f.planned();
        f.driver.execute_marks(1);
        if (i < 200) continue;
        const auto at = f.rt().position("tight", "detect");
        REQUIRE(at);
        INFO(i);
        // Since the last point half of what was launched is thought to have executed.
        CHECK(at->at.position + 30 >= std::uint32_t(i));
        CHECK(at->at.position <= std::uint32_t(i));
    }
}

TEST_CASE("Nor is one that is slow believed for ever because its instances are short",
          "[as_planned]") {
    Fixture f(true, false);
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

TEST_CASE("Without a profile an instance need not be like the last one", "[as_planned]") {
    Fixture f(true, false);
    const auto unasked = [&](const std::vector<Launch>& launches) {
        f.begin(f.thread_a, "tight");
        std::vector<bool> result;
        for (const Launch& launch : launches)
            result.push_back(f.launch_as_interposed(f.thread_a, launch));
        f.wait(f.thread_a, kStreamA);
        return result;
    };
    const Launch conv{kConv, 100, 256, kStreamA}, other{kOther, 7, 32, kStreamA};
    Launch larger = conv;
    larger.grid_blocks = 200;
    unasked({other, other, conv, conv});  // all are known now
    const std::vector<bool> all{false, true, true, true};
    CHECK(unasked({other, conv, other, conv}) == all);
    CHECK(unasked({conv, larger, conv, other}) == all);
    CHECK(unasked({conv, larger, conv, other}) == all);
    CHECK(f.stats(0).launches == 16);
    f.rt().forget_names();
    const std::vector<bool> all_but_other{false, true, true, false};
    CHECK(unasked({conv, larger, conv, other}) == all_but_other);  // it may have to be loaded
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

TEST_CASE("A call that changes the context while a launch is under way costs one more question",
          "[as_planned]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    f.planned();
    const Launch launch{kConv, 100, 256, kStreamA};
    REQUIRE(f.rt().goes_as_planned(f.thread_a, launch));
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
    auto at = f.rt().position("tight", "detect");
    REQUIRE(at);
    CHECK(at->at.position == 4);
    CHECK(at->at.unexecuted == 0us);
    CHECK(at->remaining == 1600us);
    for (int i = 0; i < 3; ++i) f.planned();
    at = f.rt().position("tight", "detect");
    REQUIRE(at);
    CHECK(at->at.position == 4);
    CHECK(at->at.unexecuted == 300us);
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
    const auto at = f.rt().position("tight", "detect");
    REQUIRE(at);
    CHECK(at->at.position >= 25);  // seen last at the 25th
    CHECK(at->remaining == at->at.unexecuted + 24 * 100us);
    CHECK(f.stats(0).launches == 36);

    SECTION("but not what it launches faster") {
        launch(10, 60us);
        CHECK(f.driver.marks.size() == 1);
    }
    SECTION("nor when somebody has come, who reckons with it as ever") {
        f.begin(f.thread_b, "loose");
        f.launch(f.thread_b, kStreamB);
        CHECK(f.stats(1).holds == 1);
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
        f.rt().task_end(f.thread_a);
        CHECK_FALSE(f.thread_a.line.as_planned.may_go_on);
        CHECK(f.thread_a.line.as_planned.left == 0);
    }
    SECTION("nor while its thread is busy with another stream") {
        launch(9, 250us);
        CHECK_FALSE(f.planned(kStreamB));  // where it would have gone on
        CHECK(f.stats(0).launches == 46);
    }
    SECTION("nor when another thread is at the task") {
        launch(9, 250us);
        f.rt().implicit_sync_begins(f.thread_a);
        CHECK(launch(1, 250us) == 1);
        f.rt().implicit_sync_ended(f.thread_a);
    }
}

TEST_CASE("A kernel of the plan is known by the handle that launched it, and by any other",
          "[as_planned]") {
    Fixture f;
    const CUfunction again = reinterpret_cast<CUfunction>(0x30);
    f.driver.names[again] = "conv";
    const auto instance = [&](CUfunction function) {
        std::vector<bool> unasked;
        f.begin(f.thread_a, "tight");
        for (int i = 0; i < 5; ++i)
            unasked.push_back(f.launch_as_interposed(
                f.thread_a, {i == 3 ? function : kConv, 100, 256, kStreamA}));
        f.wait(f.thread_a, kStreamA);
        return unasked;
    };
    const std::vector<bool> all{false, true, true, true, true};
    CHECK(instance(kConv) == all);
    // A handle that was never launched may have to be loaded, and the next launch tells that it is.
    CHECK(instance(again) == std::vector<bool>{false, true, true, false, false});
    CHECK(instance(kConv) == all);
    CHECK(instance(again) == all);
    // A module was unloaded, and its handle is another kernel's.
    f.rt().forget_names();
    f.driver.names[again] = "other";
    CHECK(instance(again) == std::vector<bool>{false, true, true, false, false});
    CHECK(instance(again) == std::vector<bool>{false, true, true, false, true});
    CHECK(f.stats(0).unknown == 2);
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
    CHECK(f.rt().position("tight", "detect")->at.position == 3);
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

TEST_CASE("A task without a profile is not asked about its kernels either", "[as_planned]") {
    Fixture f(true, false);
    f.begin(f.thread_a, "tight");
    CHECK_FALSE(f.planned());
    CHECK(f.planned());
    // A kernel that was never launched may have to be loaded: asked about. Then it is any other,
    // from the next launch on that is asked about.
    const Launch other{kOther, 7, 32, kStreamA};
    CHECK_FALSE(f.launch_as_interposed(f.thread_a, other));
    CHECK_FALSE(f.planned());
    CHECK(f.launch_as_interposed(f.thread_a, other));
    int asked = 0;
    for (int i = 5; i < 25; ++i) asked += !f.planned();
    CHECK(asked == 0);
    CHECK(f.driver.marks.empty());
    CHECK_FALSE(f.planned());  // 25 times 20 us: half of the run-ahead
    REQUIRE(f.driver.marks.size() == 1);
    CHECK(f.driver.marks[0].word0 >> 32 == 25);
    f.wait(f.thread_a, kStreamA);
    CHECK(f.stats(0).launches == 26);
    CHECK(f.stats(0).unknown == 0);  // nothing was promised
}

TEST_CASE("No kernel is asked about again because others lie where it does", "[as_planned]") {
    const bool has_profile = GENERATE(false, true);
    const std::uintptr_t distance = GENERATE(0x40, 0x5c0, 0x1000);
    Fixture f(true, has_profile);
    constexpr std::uintptr_t kKernels = 400;
    const auto handle = [&](std::uintptr_t i) {
        return reinterpret_cast<CUfunction>(0x7f0000001000 + distance * i);
    };
    for (std::uintptr_t i = 0; i < kKernels; ++i) f.driver.names[handle(i)] = "conv";
    const auto names_read = [&] {
        const int before = f.driver.num_name_queries;
        f.begin(f.thread_a, "tight");
        for (std::uintptr_t i = 0; i < kKernels; ++i) {
            f.launch_as_interposed(f.thread_a, {handle(i), 100, 256, kStreamA});
            f.driver.execute_marks(static_cast<int>(f.driver.marks.size()));
        }
        f.wait(f.thread_a, kStreamA);
        return f.driver.num_name_queries - before;
    };
    CHECK(names_read() == kKernels);
    CHECK(names_read() == 0);
    f.rt().forget_names();
    CHECK(names_read() == kKernels);
}

TEST_CASE("A thread that launches more kernels than it has room for knows the last of them",
          "[as_planned]") {
    struct Entry {
        const void* function = nullptr;
        std::uint64_t padding[3] = {};
    };
    identity::KernelCache<Entry> cache;
    std::vector<char> handles(10'000);
    for (const char& handle : handles) {
        CHECK(cache.find(&handle) == nullptr);
        cache.insert(&handle).function = &handle;
        const Entry* found = cache.find(&handle);
        REQUIRE(found != nullptr);
        CHECK(found->function == &handle);
    }
    const auto num_known = std::count_if(handles.begin(), handles.end(), [&](const char& handle) {
        return cache.find(&handle) != nullptr;
    });
    CHECK(num_known > 400);
    CHECK(cache.find(nullptr) == nullptr);
    cache.clear();
    CHECK(cache.find(&handles.back()) == nullptr);
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
        if (may_lead) f.resolved.config.scheduler.run_ahead_alone = 4ms;
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
                    if (other_is_there) f.rt().task_end(f.thread_b);
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
            f.rt().task_end(f.thread_a);
            if (may_lead && !other_is_there) f.clock.advance(one_in(2) ? 2s : 2ms);
        }
        out.launches = f.stats(0).launches;
        out.scheduled = f.stats(0).scheduled;
        out.resyncs = f.stats(0).resyncs;
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
