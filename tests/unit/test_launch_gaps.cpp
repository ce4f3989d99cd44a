// SPDX-License-Identifier: Apache-2.0
#include "host/sched/launch_gaps.h"

#include "host/sched/gpu_segment.h"
#include "tests/support/catch.h"
#include "tests/support/governor_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using sched::LaunchGaps;

namespace {

constexpr nanoseconds kRunAhead{1ms};

/// A thread that looks every 65 us, now and then late.
struct Looks {
    LaunchGaps gaps;
    nanoseconds now{1s};

    /// Looks for `time`, one of `every` of which comes `late`.
    void look(nanoseconds time, nanoseconds late, int every) {
        const nanoseconds end = now + time;
        for (int i = 1; now < end; ++i) pass(i % every == 0 ? late : 15us);
    }
    void pass(nanoseconds gap) {
        now += 50us + gap;
        gaps.slept(50us);
        gaps.passed(gap, kRunAhead, now);
    }
    nanoseconds lateness() const { return gaps.lateness(now); }
};

bool is_about(nanoseconds time, nanoseconds expected) {
    return time > expected - 20us && time < expected + 20us;
}

}  // namespace

TEST_CASE("Launch gaps are none while looks are punctual, or late by less than the run-ahead",
          "[sched][launch_gaps]") {
    Looks looks;
    CHECK(looks.lateness() == 0ns);
    looks.look(1s, 15us, 1);
    CHECK(looks.lateness() == 0ns);
    looks.look(1s, 1ms, 1);
    CHECK(looks.lateness() == 0ns);
    looks.gaps.passed(-100us, kRunAhead, looks.now);  // woken up too early
    CHECK(looks.lateness() == 0ns);
}

TEST_CASE("Launch gaps are the long ones that there are, however few", "[sched][launch_gaps]") {
    Looks looks;
    const int every = GENERATE(20, 100, 1000);  // 4 % of the time
    looks.look(2s, 3ms, every);
    CHECK(is_about(looks.lateness(), 3ms));
    looks.look(4s, 1500us, every / 2);
    CHECK(is_about(looks.lateness(), 1500us));
}

TEST_CASE("Launch gaps that are a thousandth of the time count for little",
          "[sched][launch_gaps]") {
    Looks looks;
    looks.look(10s, 2ms, 30000);
    looks.pass(2ms);
    CHECK(looks.lateness() > 0ns);
    CHECK(looks.lateness() < 1ms);
}

TEST_CASE("Launch gaps are forgotten with time, whether the task is paced or not",
          "[sched][launch_gaps]") {
    Looks looks;
    looks.look(2s, 3ms, 20);
    SECTION("paced, on free cores") {
        looks.look(6s, 15us, 1);
    }
    SECTION("not paced") {
        looks.now += 6s;
    }
    CHECK(looks.lateness() < 300us);
}

TEST_CASE("A long stop is a gap of four run-aheads, and over in a few seconds",
          "[sched][launch_gaps]") {
    Looks looks;
    looks.pass(3s);
    CHECK(looks.lateness() == 4ms);
    looks.now += 4s;
    CHECK(looks.lateness() < 200us);
}

namespace {

/// A paced launch, whose sleeps take longer than they were to.
struct LatePacing {
    GovernorFixture f{{100ms, 50ms}};

    LatePacing() {
        f.begin(0, 400ms);
        for (int i = 0; i < 3; ++i) f.launch(0, 500us);
    }
    /// A launch asks. @returns how it waits for its run-ahead
    sched::Wait ask() {
        const auto answer = f.ask(0);
        REQUIRE(answer.wait);
        REQUIRE(answer.wait->is_paced);
        return *answer.wait;
    }
    void wait(const sched::Wait& wait, nanoseconds late) {
        f.governor.sleeps(f.task(0), wait);
        f.now += wait.sleep + late;
        f.governor.slept(f.task(0), wait, wait.sleep + late, f.now);
    }
    /// @returns whether a launch waits that is so far ahead of the GPU
    bool is_paced_at(nanoseconds ahead) {
        f.execute(0);
        f.ask(0);
        for (int i = 0; i < 2; ++i) f.launch(0, ahead / 2);
        return f.ask(0).wait.has_value();
    }
};

}  // namespace

TEST_CASE("A launch whose thread wakes up late may be farther ahead of the GPU",
          "[sched][launch_gaps]") {
    LatePacing late;
    const bool is_late = GENERATE(true, false);
    GovernorFixture& f = late.f;
    for (int i = 0; i < 50; ++i) {
        sched::Wait wait = late.ask();
        wait.sleep = 2500us;  // as it was told: no gap
        late.wait(wait, is_late && i % 5 == 0 ? 2ms : 15us);
        f.execute(0);
        f.ask(0);
        for (int j = 0; j < 2; ++j) f.launch(0, 3ms);
    }
    CHECK(late.is_paced_at(2800us) == !is_late);
    CHECK(late.is_paced_at(3600us));
}

TEST_CASE("A thread that loses its core between two launches has gaps", "[sched][launch_gaps]") {
    LatePacing late;
    GovernorFixture& f = late.f;
    late.wait(late.ask(), 0ms);
    f.ask(0);
    CHECK(f.task(0).record.gaps.lateness(f.now) == 0ns);
    f.now += 2ms;
    f.ask(0);
    CHECK(f.task(0).record.gaps.lateness(f.now) == 2ms);
}

TEST_CASE("Launches that were not paced, wait for others, or behind gates tell no gaps",
          "[sched][launch_gaps]") {
    enum Waits { kNotPaced, kForOthers, kBehindGate, kInCall };
    const auto waits = GENERATE(kNotPaced, kForOthers, kBehindGate, kInCall);
    LatePacing late;
    GovernorFixture& f = late.f;
    const sched::Wait wait = late.ask();
    if (waits != kNotPaced) late.wait(wait, 0ms);
    for (int i = 0; i < 10; ++i) {
        if (waits == kForOthers) {
            sched::Wait held = wait;
            held.is_paced = false;
            late.wait(held, 2ms);
        } else {
            if (waits == kBehindGate) f.governor.sleeps(f.task(0), wait);
            if (waits == kInCall) f.task(0).run.pace.no_gap();
            f.now += 2ms;
        }
        f.ask(0);
    }
    CHECK(f.task(0).record.gaps.lateness(f.now) == 0ns);
}

TEST_CASE("What passes between two GPU segments is no gap", "[sched][launch_gaps]") {
    LatePacing late;
    GovernorFixture& f = late.f;
    late.wait(late.ask(), 0ms);
    f.ask(0);
    f.governor.leaves_gpu(f.task(0), f.now);
    f.now += 2ms;
    sched::enter_gpu_segment(f.governor, f.task(0), {}, f.now);
    f.now += 2ms;  // not paced in this one yet
    f.ask(0);
    CHECK(f.task(0).record.gaps.lateness(f.now) == 0ns);
}
