// SPDX-License-Identifier: Apache-2.0
//
// What the Governor holds beside a busy bystander (host/sched/bystanders.h).
#include "host/sched/governor.h"
#include "tests/support/catch.h"
#include "tests/support/governor_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using sched::Answer;
using sched::Why;

TEST_CASE("A long kernel is held beside a busy bystander, whatever was decided of short ones",
          "[sched][governor]") {
    config::Scheduler scheduler;
    scheduler.policy = config::Policy::kEdf;
    GovernorFixture f({300ms, 50ms}, scheduler);
    sched::Bystanders& bystanders = f.governor.bystanders();
    const auto make_busy = [&] {
        f.bystander_gets_busy();
        for (int i = 0; i < 3; ++i) bystanders.measured(2ms, 1ms, 20);  // 50 us longer a launch
    };
    make_busy();
    REQUIRE(bystanders.are_busy(5us));
    REQUIRE_FALSE(bystanders.are_busy(150us));

    for (int i : {0, 1}) f.begin(i, 20ms);
    f.launch(1, 500us);
    CHECK_FALSE(f.ask(0, 5us).wait);
    f.task(0).run.next = 5us;
    f.task(0).decision.decision.is_free = true;  // as if it came first
    CHECK(f.governor.goes_as_before(f.task(0), f.now));
    f.task(0).run.next = 150us;
    CHECK_FALSE(f.governor.goes_as_before(f.task(0), f.now));
    const Answer waits = f.ask(0, 150us);
    REQUIRE(waits.wait);
    CHECK(waits.wait->why == Why::kRank);
    CHECK(f.ask(0, 800us).wait);
    f.now += 245ms;
    make_busy();
    f.begin(1, 20ms);
    f.launch(1, 500us);
    CHECK_FALSE(f.ask(0, 150us).wait);  // no time to spare by what it takes beside the bystander
    const Answer still_waits = f.ask(0, 800us);
    REQUIRE(still_waits.wait);
    CHECK(still_waits.wait->why == Why::kRank);
}

TEST_CASE("Beside a busy bystander many short kernels have to go on before a few long ones",
          "[sched][governor]") {
    GovernorFixture f({50ms, 60ms});
    const auto plan_of = [](int kernels, nanoseconds each, const char* name = "k") {
        config::TaskProfile profile;
        for (int i = 0; i < kernels; ++i)
            profile.kernels.push_back({.name = name, .gpu_time = each, .utilization = 1});
        return model::TaskPlan(profile);
    };
    const auto rank_of_first = [&](bool beside) {
        if (beside) f.bystander_gets_busy();
        for (int i : {0, 1}) {
            f.task(i).estimated.gpu_ns = f.task(i).plan.gpu_time().count();
            f.begin(i, 4ms);
        }
        f.launch(1, 10us);
        return f.ask(0, 10us).decision.rank;
    };
    f.task(0).plan = plan_of(4, 1ms);
    SECTION("short kernels") {
        f.task(1).plan = plan_of(400, 10us);  // 50 us longer each: 20 ms
    }
    SECTION("a graph of them") {
        f.task(1).plan = plan_of(1, 4ms, "(graph of 400 kernels, 8f3a12bc)");
    }
    SECTION("without a bystander the deadlines tell") {
        f.task(1).plan = plan_of(400, 10us);
        CHECK(rank_of_first(false) == 0);
        return;
    }
    CHECK(rank_of_first(true) == 1);
}

TEST_CASE("A graph is no long kernel beside a busy bystander", "[sched][governor]") {
    config::Scheduler scheduler;
    scheduler.policy = config::Policy::kEdf;
    GovernorFixture f({300ms, 50ms}, scheduler);
    f.bystander_gets_busy();
    for (int i = 0; i < 3; ++i) f.governor.bystanders().measured(2ms, 1ms, 20);
    const bool is_graph = GENERATE(true, false);
    config::TaskProfile profile;
    profile.kernels.push_back(
        {.name = is_graph ? "(graph of 400 kernels, 1)" : "k", .gpu_time = 4ms, .utilization = 1});
    f.task(0).plan = model::TaskPlan(profile);
    for (int i : {0, 1}) f.begin(i, 20ms);
    f.launch(1, 500us);
    CHECK(f.ask(0, 4ms).wait.has_value() != is_graph);
}
