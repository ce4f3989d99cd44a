// SPDX-License-Identifier: Apache-2.0
#include "host/sched/launch_gaps.h"

#include "tests/support/catch.h"
#include "tests/support/governor_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using sched::LaunchGaps;

namespace {

constexpr nanoseconds kSleep{50us}, kPunctual{15us};

/// Looks for `time`, one of `every` of which comes `late`.
void look(LaunchGaps& gaps, nanoseconds time, nanoseconds late, int every) {
    for (int i = 1; time.count() > 0; ++i) {
        const nanoseconds took = kSleep + (i % every == 0 ? late : kPunctual);
        gaps.passed(took, kSleep);
        time -= took;
    }
}

}  // namespace

TEST_CASE("Launch gaps are none while looks are punctual", "[sched][launch_gaps]") {
    LaunchGaps gaps;
    CHECK(gaps.lateness() == 0ns);
    look(gaps, 1s, kPunctual, 1);
    CHECK(gaps.lateness() == 0ns);
    look(gaps, 1s, 190us, 1);
    CHECK(gaps.lateness() == 0ns);
    gaps.passed(5ms, 5ms);  // as it was told
    CHECK(gaps.lateness() == 0ns);
}

TEST_CASE("Launch gaps are the long ones that there are, however few", "[sched][launch_gaps]") {
    LaunchGaps gaps;
    const int every = GENERATE(20, 100, 500);
    look(gaps, 2s, 3ms, every);
    CHECK(gaps.lateness() == 3ms);
    look(gaps, 2s, 1ms, every / 2);
    CHECK(gaps.lateness() >= 980us);
    CHECK(gaps.lateness() <= 1020us);
    look(gaps, 4s, kPunctual, 1);
    CHECK(gaps.lateness() < 5us);
}

TEST_CASE("Launch gaps that are a thousandth of the time, or one by itself, count for little",
          "[sched][launch_gaps]") {
    LaunchGaps seldom, once;
    look(seldom, 10s, 1ms, 15000);
    CHECK(seldom.lateness() > 0ns);
    CHECK(seldom.lateness() < 100us);
    once.passed(kSleep + 400us, kSleep);
    CHECK(once.lateness() < 100us);
    once.passed(kSleep + 1s, kSleep);
    CHECK(once.lateness() == LaunchGaps::kMost);
}

namespace {

/// A paced launch, whose sleeps take longer than they were to.
struct LatePacing {
    GovernorFixture f{{100ms, 50ms}};

    LatePacing() {
        f.begin(0, 400ms);
        for (int i = 0; i < 3; ++i) f.launch(0, 500us);
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
        const auto answer = f.ask(0);
        REQUIRE(answer.wait);
        REQUIRE(answer.wait->is_paced);
        late.wait(*answer.wait, is_late && i % 10 == 0 ? 2ms : 15us);
        f.execute(0);
        f.ask(0);
        for (int j = 0; j < 2; ++j) f.launch(0, 3ms);
    }
    CHECK(late.is_paced_at(2800us) == !is_late);
    CHECK(late.is_paced_at(3600us));
}

TEST_CASE("Launches that wait for others, behind gates, or for their segment tell no gaps",
          "[sched][launch_gaps]") {
    enum Waits { kForOthers, kBehindGate, kForProgram };
    const auto waits = GENERATE(kForOthers, kBehindGate, kForProgram);
    LatePacing late;
    GovernorFixture& f = late.f;
    const auto answer = f.ask(0);
    REQUIRE(answer.wait);
    late.wait(*answer.wait, 0ms);
    for (int i = 0; i < 10; ++i) {
        switch (waits) {
            case kForOthers: {
                sched::Wait held = *answer.wait;
                held.is_paced = false;
                late.wait(held, 2ms);
                break;
            }
            case kBehindGate:  // no thread sleeps
                f.governor.sleeps(f.task(0), *answer.wait);
                f.now += 2ms;
                break;
            case kForProgram:  // its next segment begins then
                f.ask(0);
                f.now += 2ms;
                f.task(0).run.segment.time = f.now;
                break;
        }
        f.ask(0);
    }
    CHECK(f.task(0).record.gaps.lateness() == 0ns);
}
