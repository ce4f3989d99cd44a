// SPDX-License-Identifier: Apache-2.0
//
// When the runtime holds or paces a launch, and for how long, in virtual time.
#include <algorithm>
#include <vector>

#include "tests/support/runtime_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using config::Mode;
using Fixture = RuntimeFixture;

TEST_CASE("Runtime paces a task that runs ahead until the GPU has caught up", "[runtime][hold]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 10; ++i) f.launch(f.thread_a);
    CHECK(f.clock.num_sleeps == 0);  // 1 ms of run-ahead
    f.clock.on_sleep = [&] {
        if (f.clock.num_sleeps == 3) f.driver.execute_marks(1);
    };
    f.launch(f.thread_a);
    f.launch(f.thread_a);
    CHECK(f.clock.num_sleeps == 3);
    CHECK(f.stats(0).tasks.holds == 0);  // nobody was in its way
}

TEST_CASE("Runtime always lets two kernels be queued however long they are", "[runtime][hold]") {
    Fixture f;
    f.resolved.profile->chains[0].tasks[0].kernels.assign(4, {"conv", 100, 256, 5ms, 1.0});
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    f.launch(f.thread_a);
    CHECK(f.clock.num_sleeps == 0);
    f.clock.on_sleep = [&] { f.driver.execute_marks(1); };
    f.launch(f.thread_a);
    CHECK(f.clock.num_sleeps == 1);
}

TEST_CASE("Runtime holds the less urgent task until the more urgent one has finished",
          "[runtime][hold]") {
    Fixture f;
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_b, kStreamB);
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    f.wait_a();            // its thread waits for the GPU
    f.clock.advance(1ms);  // beyond the grace between launches
    f.clock.on_sleep = [&] {
        if (f.clock.num_sleeps == 4) f.driver.execute_marks(1);
    };
    const Grant g = f.launch(f.thread_b, kStreamB);
    CHECK(f.clock.num_sleeps == 4);
    CHECK(g.priority == -5);  // by then alone
    CHECK(f.stats(1).tasks.holds == 1);
    CHECK(f.stats(1).tasks.held_ns == std::chrono::nanoseconds(200us).count());
    CHECK(f.stats(0).tasks.holds == 0);
}

TEST_CASE("Runtime lets small kernels of a less urgent task pass at a lower priority",
          "[runtime][hold]") {
    Fixture f(0.5);
    f.begin(f.thread_a, "tight");
    f.begin(f.thread_b, "loose");
    CHECK(f.launch(f.thread_a).priority == -5);
    CHECK(f.launch(f.thread_b, kStreamB).priority == -4);
    CHECK(f.clock.num_sleeps == 0);
}

TEST_CASE("Runtime does not pace a task whose stream waits for something else", "[runtime][hold]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    // Nothing executes: a stream memory operation waits for this very thread, say.
    for (int i = 0; i < 20; ++i) f.launch(f.thread_a);
    CHECK(f.clock.now() - 1s <= 3ms);
}

TEST_CASE("Runtime counts work that the plan does not know", "[runtime][hold]") {
    Fixture f;
    f.resolved.profile->chains[0].tasks[0].kernels.resize(1);
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_b, kStreamB);
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 3; ++i) f.launch(f.thread_a);  // two more than planned
    f.wait_a();
    f.clock.advance(1ms);
    f.driver.execute_marks(1);
    f.clock.on_sleep = [&] {
        if (f.clock.num_sleeps == 4) f.driver.execute_marks(1);
    };
    f.launch(f.thread_b, kStreamB);
    CHECK(f.clock.num_sleeps == 4);
}

TEST_CASE("Runtime ends a hold when the blocker's mark is overdue", "[runtime][hold]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_a);
    f.wait_a();
    f.launch(f.thread_b, kStreamB);  // the mark never executes: 2 * 100 us + 1 ms
    CHECK(f.clock.num_sleeps >= 24);
    CHECK(f.clock.num_sleeps <= 26);
}

TEST_CASE("Runtime gives overdue work the GPU now and then, the more seldom the longer it waits",
          "[runtime][hold]") {
    Fixture f;
    f.resolved.config.chains[0].deadline = 600ms;
    f.resolved.config.chains[1].deadline = 900ms;
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    f.wait_a();
    f.driver.marks.clear();  // never executes
    f.begin(f.thread_b, "loose");
    // The less urgent one launches every half of a millisecond.
    std::vector<nanoseconds> begins;
    nanoseconds held{0};
    const nanoseconds begin = f.clock.now();
    while (f.clock.now() - begin < 300ms) {
        const nanoseconds before = f.clock.now();
        f.launch(f.thread_b, kStreamB);
        f.driver.execute_marks(1);
        if (f.clock.now() > before) begins.push_back(before - begin);
        held += f.clock.now() - before;
        f.clock.advance(500us);
    }
    REQUIRE(begins.size() == 6);
    CHECK(begins[0] == 0ms);  // until it is overdue
    CHECK(begins[1] > 10ms);
    CHECK(begins[1] < 12ms);
    for (std::size_t i = 2; i < begins.size(); ++i) CHECK(begins[i] > 2 * begins[i - 1]);
    CHECK(held < 300ms / 8);
}

TEST_CASE("Frames are in time beside work that waits for ever for something else",
          "[runtime][hold]") {
    Fixture f;
    f.resolved.config.chains[0].deadline = 100ms;
    f.resolved.config.chains[1].period = f.resolved.config.chains[1].deadline = 33ms;
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    f.wait_a();
    f.driver.marks.clear();  // never executes
    const nanoseconds begin = f.clock.now();
    nanoseconds longest{0};
    while (f.clock.now() - begin < 120s) {
        const nanoseconds frame = f.clock.now();
        f.begin(f.thread_b, "loose");
        for (int i = 0; i < 20; ++i) {
            f.launch(f.thread_b, kStreamB);
            f.driver.execute_marks(static_cast<int>(f.driver.marks.size()));
            f.clock.advance(100us);
        }
        f.rt().frames().task_end(f.thread_b);
        longest = std::max(longest, f.clock.now() - frame);
        f.clock.advance(frame + 33ms - f.clock.now());
    }
    CHECK(longest > 2ms);
    CHECK(longest < 5ms);
    CHECK(f.stats(1).frames.missed == 0);
}

TEST_CASE("Runtime ends a hold within one poll when it is switched off", "[runtime][hold]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_a);
    f.wait_a();
    f.clock.on_sleep = [&] { f.rt().steering().set_mode(Mode::kOff); };
    f.launch(f.thread_b, kStreamB);
    CHECK(f.clock.num_sleeps == 1);
    CHECK(f.launch(f.thread_b, kStreamB).task == nullptr);
}

TEST_CASE("Runtime adds at most the instance's bound by holding, and counts that it opened",
          "[runtime][hold]") {
    Fixture f;
    SECTION("that the config says") {
        f.resolved.config.scheduler.hold.max_per_instance = 2ms;
    }
    SECTION("in deadlines that the config says") {
        f.resolved.config.scheduler.hold.max_deadlines = 0.02;
    }
    f.begin(f.thread_a, "tight");
    f.begin(f.thread_b, "loose");
    f.clock.on_sleep = [&] {  // keeps launching: blocks forever
        f.driver.execute_marks(99);
        f.launch(f.thread_a);
    };
    f.launch(f.thread_a);
    f.launch(f.thread_b, kStreamB);
    CHECK(f.stats(1).tasks.held_ns == std::chrono::nanoseconds(2ms).count());
    CHECK(f.stats(1).tasks.holds_opened == 1);
    const int sleeps = f.clock.num_sleeps;
    f.launch(f.thread_b, kStreamB);  // and from then on at once
    CHECK(f.clock.num_sleeps == sleeps);
}

TEST_CASE("Runtime forgets a segment when the program has waited for its stream", "[runtime]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_a);
    f.wait_a();
    CHECK_FALSE(f.begin_wait(f.thread_a, kStreamB).for_all);
    f.wait(f.thread_a, kStreamA);
    f.launch(f.thread_b, kStreamB);
    CHECK(f.clock.num_sleeps == 0);
}

TEST_CASE("Runtime looks at the others again when somebody came to the GPU", "[runtime][hold]") {
    Fixture f;
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_b, kStreamB);
    f.launch(f.thread_b, kStreamB);
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    f.begin_wait(f.thread_a, kStreamA);
    f.clock.on_sleep = [&] { f.driver.execute_marks(9); };
    f.launch(f.thread_b, kStreamB);  // at the same instant: nothing remembered may let it go
    CHECK(f.clock.num_sleeps >= 1);
}
