// SPDX-License-Identifier: Apache-2.0
//
// Turns at launching, as the Governor asks for them (host/model/launch_contention.h).
#include "host/sched/governor.h"
#include "tests/support/catch.h"
#include "tests/support/governor_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using sched::Answer;
using sched::Why;

namespace {

config::Scheduler one_at_a_time() {
    config::Scheduler scheduler;
    scheduler.policy = config::Policy::kEdf;
    scheduler.packing.launchers = 1;
    return scheduler;
}

/// It was seen to launch so many times as slowly beside others.
void slow_down(GovernorFixture& f, int task, double times) {
    const auto took = nanoseconds(static_cast<std::int64_t>(times * 3'000'000));
    for (std::size_t i = 0; i < model::LaunchContention::kTogetherFirst; ++i)
        f.task(task).record.contention.observe(
            {.took = took, .alone = 3ms, .marks = 8, .beside = 8, .others = 8}, f.now);
    REQUIRE(f.task(task).record.contention.verdict() == model::Launching::kSlowed);
    f.slot(task).launching = model::Launching::kSlowed;
}

}  // namespace

TEST_CASE("A turn to launch was awaited in vain if none of those that pause got on meanwhile",
          "[sched][governor][launching]") {
    GovernorFixture f({100ms, 20ms}, one_at_a_time());
    model::LaunchContention& contention = f.task(0).record.contention;
    slow_down(f, 0, 3);
    f.slot(1).launching = model::Launching::kSlowed;
    f.begin(1, 20ms);
    REQUIRE(f.slot(1).head_remaining_ns > 0);
    sched::Decision only_as_others_pause;
    only_as_others_pause.others_pause = true;
    only_as_others_pause.before.insert(1);
    const auto three_holds = [&](nanoseconds launch) {
        for (int i = 0; i < 3; ++i) {
            const nanoseconds since = f.now;
            f.slot(1).launch_ns = (since + launch).count();
            f.now += 3ms;
            f.governor.estimates().waited_for_turn(f.task(0), only_as_others_pause, since, f.now);
        }
        return contention.verdict();
    };
    CHECK(three_holds(2ms) == model::Launching::kSlowed);
    SECTION("it was past what the held one has") {
        CHECK(three_holds(100us) == model::Launching::kFree);
    }
    SECTION("who needs nothing of it says nothing") {
        f.slot(1).launching = GENERATE(model::Launching::kFree, model::Launching::kParallel);
        CHECK(three_holds(2ms) == model::Launching::kFree);
    }
    SECTION("nor who has launched all") {
        f.slot(1).head_remaining_ns = 0;
        CHECK(three_holds(2ms) == model::Launching::kFree);
    }
    SECTION("nor who comes later") {
        only_as_others_pause.before = {};
        CHECK(three_holds(2ms) == model::Launching::kFree);
    }
}

TEST_CASE("Beside a busy bystander turns at launching are taken where they matter much",
          "[sched][governor][launching]") {
    GovernorFixture f({300ms, 50ms}, one_at_a_time());
    f.bystander_gets_busy();
    REQUIRE(f.governor.bystanders().are_busy(5us));
    for (int i : {0, 1}) f.begin(i, 20ms);
    f.slot(1).launching = model::Launching::kSlowed;
    f.launch(1, 5us);
    slow_down(f, 0, 1.6);
    CHECK_FALSE(f.ask(0, 5us).wait);
    slow_down(f, 0, 3);
    f.now += 1ms;
    f.launch(1, 5us);
    const Answer waits = f.ask(0, 5us);
    REQUIRE(waits.wait);
    CHECK(waits.wait->why == Why::kTurnToLaunch);
    CHECK(waits.wait->behind == 1);
    CHECK_FALSE(f.ask(0, 5us, {.enforces = false}).wait);
}

TEST_CASE("Turns at launching are taken only behind those that may need the same lock",
          "[sched][governor][launching]") {
    GovernorFixture f({300ms, 50ms}, one_at_a_time());
    for (int i : {0, 1}) f.begin(i, 20ms);
    slow_down(f, 0, 3);
    const bool waits = GENERATE(true, false);
    f.slot(1).launching = waits ? model::Launching::kUnknown
                                : GENERATE(model::Launching::kFree, model::Launching::kParallel);
    f.launch(1, 5us);
    const Answer answer = f.ask(0, 5us);
    CHECK(answer.decision.launches_late == waits);
}

TEST_CASE("Beside a busy bystander who takes no turns is not asked at each launch",
          "[sched][governor][launching]") {
    GovernorFixture f({300ms, 50ms}, one_at_a_time());
    f.bystander_gets_busy();
    for (int i : {0, 1}) f.begin(i, 20ms);
    f.launch(1, 5us);
    // Three times as slow among six, who get twice as much launched as one alone.
    for (std::size_t i = 0; i < model::LaunchContention::kTogetherFirst; ++i)
        f.task(0).record.contention.observe(
            {.took = 9ms, .alone = 3ms, .marks = 8, .beside = 8, .others = 40}, f.now);
    REQUIRE(f.task(0).record.contention.slowdown() == Approx(3));
    REQUIRE(f.task(0).record.contention.verdict() == model::Launching::kParallel);
    CHECK(f.ask(0, 5us).decision.is_free);
}

TEST_CASE("A launch-bound task that may go looks no more for a moment", "[sched][governor]") {
    const auto admitted = [](GovernorFixture& f, bool launch_bound) {
        f.task(0).estimated.gpu_ns = nanoseconds(2ms).count();
        f.task(0).estimated.idle_ns = launch_bound ? nanoseconds(8ms).count() : 0;
        f.begin(1, 2ms, 0.3);
        f.begin(0, 2ms, 0.3);
        f.launch(1, 100us);
        REQUIRE_FALSE(f.ask(0).wait);
        REQUIRE_FALSE(f.task(0).decision.decision.is_free);
    };
    const auto goes = [](GovernorFixture& f, nanoseconds later) {
        f.now += later;
        return f.governor.goes_as_before(f.task(0), f.now).has_value();
    };
    GovernorFixture f({100ms, 50ms}), gpu_bound({100ms, 50ms});
    admitted(gpu_bound, false);
    CHECK_FALSE(goes(gpu_bound, 1us));

    admitted(f, true);
    CHECK(goes(f, 50us));
    f.slot(0).head_utilization_ppm = 400'000;  // it takes more of the GPU
    CHECK_FALSE(goes(f, 1us));
    f.slot(0).head_utilization_ppm = 200'000;
    CHECK(goes(f, 48us));
    CHECK_FALSE(goes(f, 2us));

    REQUIRE_FALSE(f.ask(0).wait);
    CHECK(goes(f, 50us));
    f.governor.tasks().changed();
    CHECK_FALSE(goes(f, 1us));
    f.slot(0).head_utilization_ppm = 900'000;
    REQUIRE(f.ask(0).wait);  // what was held is asked about
    CHECK_FALSE(goes(f, 1us));
}
