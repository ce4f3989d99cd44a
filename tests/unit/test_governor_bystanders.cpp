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
