// SPDX-License-Identifier: Apache-2.0
//
// When a frame of a thread that gives no hints has arrived.
#include <time.h>

#include "tests/support/runtime_fixture.h"

namespace urgengo::testing {
namespace {

// A thread named as the task of `loose`: a period of 200 ms, a deadline of 100 ms.
struct RuntimeArrivalsTest : RuntimeFixture {
    const ThreadName name{"th_loose"};
    std::chrono::nanoseconds arrival() {
        const Grant g = launch(thread_a);
        REQUIRE(g.task);
        return g.task->tracked.arrival;
    }
    /// A frame that takes 1 ms; its thread is done now.
    void frame() {
        launch(thread_a);
        clock.advance(1ms);
        wait(thread_a, kStreamA);
    }
};

/// The thread computes for so long, and virtual time passes for at least as long.
void compute(HookedClock& clock, std::chrono::nanoseconds cpu) {
    const auto used = [] {
        timespec t;
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
        return std::chrono::seconds(t.tv_sec) + std::chrono::nanoseconds(t.tv_nsec);
    };
    for (const auto begin = used(); used() - begin < cpu;) {
    }
    clock.advance(2 * cpu);
}

}  // namespace

TEST_CASE("Runtime takes a frame of a thread that is behind for one that arrived a period later",
          "[runtime][instances]") {
    RuntimeArrivalsTest f;
    const auto first = f.arrival();
    f.clock.advance(150ms);
    f.wait(f.thread_a, kStreamA);
    f.clock.advance(130ms);  // asleep until its frame came
    const auto second = f.arrival();
    CHECK(second > first + 279ms);
    CHECK(second <= first + 280ms);
    f.clock.advance(300ms);
    f.wait(f.thread_a, kStreamA);
    CHECK(f.arrival() == second + 200ms);  // goes on at once
}

TEST_CASE("A frame has arrived at its first call, less the CPU time since the thread's last wait",
          "[runtime][arrivals]") {
    RuntimeArrivalsTest f;
    f.frame();
    f.clock.advance(50ms);  // asleep
    compute(f.clock, 3ms);
    const auto now = f.clock.now(), arrival = f.arrival();
    CHECK(arrival <= now - 3ms);
    CHECK(arrival >= now - 6ms);
}

TEST_CASE("A frame that follows the last one at once has arrived when that was over",
          "[runtime][arrivals]") {
    RuntimeArrivalsTest f;
    f.frame();
    const auto end = f.clock.now();
    SECTION("At once is half a millisecond") {
        f.clock.advance(500us);
        CHECK(f.arrival() == end);
    }
    SECTION("and no more") {
        f.clock.advance(510us);
        CHECK(f.arrival() > end);
    }
}

TEST_CASE("What is at once is less where deadlines are short", "[runtime][arrivals]") {
    RuntimeArrivalsTest f;
    f.resolved.config.chains[1].deadline = 3200us;
    f.frame();
    const auto end = f.clock.now();
    SECTION("A 32nd of one") {
        f.clock.advance(100us);
        CHECK(f.arrival() == end);
    }
    SECTION("and no more") {
        f.clock.advance(110us);
        CHECK(f.arrival() > end);
    }
}

TEST_CASE("The first frame after a pause has not arrived before it", "[runtime][arrivals]") {
    RuntimeArrivalsTest f;
    for (int i = 0; i < 6; ++i) {  // one at once behind the other, longer than the period
        f.launch(f.thread_a);
        f.clock.advance(300ms);
        f.wait(f.thread_a, kStreamA);
    }
    const auto missed = f.stats(1).frames.missed.load();
    f.clock.advance(5s);  // no input
    CHECK(f.arrival() >= f.clock.now() - 1ms);
    f.clock.advance(1ms);
    f.wait(f.thread_a, kStreamA);
    CHECK(f.stats(1).frames.missed == missed);
}

TEST_CASE("Each frame of a thread that takes names in turns is found", "[runtime][arrivals]") {
    RuntimeFixture f;
    const std::uint64_t every = GENERATE(2, 3, 10, 16);
    for (std::uint64_t i = 0; i < 320; ++i) {
        const ThreadName name(i % every == every - 1 ? "th_tight" : "th_loose");
        f.launch(f.thread_a);
        f.wait(f.thread_a, kStreamA);
    }
    CHECK(f.stats(0).frames.instances == 320 / every);
}

}  // namespace urgengo::testing
