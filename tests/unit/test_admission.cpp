// SPDX-License-Identifier: Apache-2.0
#include "host/sched/admission.h"

#include <vector>

#include "tests/support/catch.h"
#include "tests/support/slot_views.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
using config::Scheduler;
using model::SlotView;
using sched::nanoseconds;

TEST_CASE("Packed admits the most urgent task whatever its size", "[sched][admission]") {
    const auto d = decide_for(task(0, 5ms, 1.0), {task(1, 6ms, 1.0), task(2, 50ms, 1.0)}, kUrgency);
    CHECK(d.admit);
    CHECK(d.rank == 0);
}

TEST_CASE("Packed holds a launch that does not fit beside more urgent ones", "[sched][admission]") {
    const auto d = decide_for(task(0, 10ms, 0.5), {task(1, 5ms, 0.6)}, kUrgency);
    CHECK_FALSE(d.admit);
    CHECK(d.rank == 1);
    CHECK(d.utilization == Approx(1.1));
}

TEST_CASE("Packed admits a launch that fits beside more urgent ones", "[sched][admission]") {
    CHECK(decide_for(task(0, 10ms, 0.45), {task(1, 5ms, 0.6)}, kUrgency)
              .admit);  // exactly pack_limit
    const auto three =
        decide_for(task(0, 30ms, 0.2), {task(1, 5ms, 0.4), task(2, 9ms, 0.4)}, kUrgency);
    CHECK(three.admit);
    CHECK(three.rank == 2);
}

TEST_CASE("Packed does not hold for a task that blocks nobody, but ranks behind it",
          "[sched][admission]") {
    SlotView waiting = task(1, 5ms, 1.0);
    waiting.state.blocking = false;
    const auto d = decide_for(task(0, 10ms, 1.0), {waiting}, kUrgency);
    CHECK(d.admit);
    CHECK(d.rank == 1);
    CHECK(d.num_tasks == 2);
}

TEST_CASE("Ties go to the lower task, so exactly one of two is first", "[sched][policy]") {
    const SlotView a = task(0, 7ms, 1.0), b = task(1, 7ms, 1.0);
    CHECK(decide_for(a, {b}, kUrgency).rank == 0);
    CHECK(decide_for(b, {a}, kUrgency).rank == 1);
}

TEST_CASE("Admission none admits everything and still ranks", "[sched][admission]") {
    Scheduler none = kUrgency;
    none.admission = config::Admission::kNone;
    const auto d = decide_for(task(0, 10ms, 1.0), {task(1, 5ms, 1.0)}, none);
    CHECK(d.admit);
    CHECK(d.rank == 1);
}

TEST_CASE("A demoted task goes only where nobody else wants the GPU", "[sched][admission]") {
    SlotView late = task(0, -1ms, 0.1);
    late.state.demoted = true;
    SlotView later = task(1, -50ms, 0.1);
    const auto beside = decide_for(late, {later}, kUrgency);
    CHECK(beside.rank == 1);
    CHECK_FALSE(beside.admit);
    CHECK(decide_for(later, {late}, kUrgency).rank == 0);
    later.state.blocking = false;
    CHECK(decide_for(late, {later}, kUrgency).admit);
}

TEST_CASE("With slack in the plan more may share the GPU", "[sched][admission]") {
    const std::vector tasks{task(1, 50ms, 0.7, 200ms), task(0, 5ms, 0.8, 100ms)};
    const auto admits = [&](nanoseconds slack) {
        sched::Snapshot snapshot{0ns, tasks};
        snapshot.plan.slack = slack;
        return sched::decide(Scheduler{}, snapshot).admit;
    };
    CHECK_FALSE(admits(0ns));
    CHECK_FALSE(admits(9'999'999ns));
    CHECK(admits(10ms));
    Scheduler narrow;
    narrow.packing.share_limit = 1.4;
    sched::Snapshot snapshot{0ns, tasks};
    snapshot.plan.slack = 500ms;
    CHECK_FALSE(sched::decide(narrow, snapshot).admit);
}

TEST_CASE("Where some are tight, who comes before them may share the GPU", "[sched][admission]") {
    std::vector tasks{task(1, 50ms, 0.7, 200ms), task(0, 5ms, 0.8, 100ms)};
    const auto admits = [&](const sched::TaskSet& may_share) {
        sched::Snapshot snapshot{0ns, tasks};
        snapshot.plan = {.may_share = may_share, .slack = 4ms};
        return sched::decide(Scheduler{}, snapshot).admit;
    };
    CHECK(admits({1}));
    CHECK_FALSE(admits({0}));  // the other one may
    tasks[1].state.needs_all = true;
    CHECK_FALSE(admits({1}));
}

TEST_CASE("Slack lets nobody add to what somebody waits for to drain", "[sched][admission]") {
    std::vector tasks{task(1, 50ms, 0.7, 200ms), task(0, 5ms, 0.8, 100ms)};
    sched::Snapshot snapshot{0ns, tasks};
    snapshot.plan.slack = 500ms;
    CHECK(sched::decide(Scheduler{}, snapshot).admit);
    tasks[1].state.needs_all = true;
    CHECK_FALSE(sched::decide(Scheduler{}, snapshot).admit);
}

TEST_CASE("Slack lets no demoted task in, and never less share than without it",
          "[sched][admission]") {
    std::vector tasks{task(1, 50ms, 0.5, 200ms), task(0, 5ms, 0.5, 100ms)};
    sched::Snapshot snapshot{0ns, tasks};
    Scheduler narrow;
    narrow.packing.share_limit = 0.6;
    snapshot.plan.slack = 500ms;
    CHECK(sched::decide(narrow, snapshot).admit);  // pack_limit holds
    tasks[0].state.demoted = true;
    CHECK_FALSE(sched::decide(narrow, snapshot).admit);
}

TEST_CASE("Who has starved comes before everybody, the one that is late the longest first",
          "[sched][admission]") {
    const auto policy = GENERATE(config::Policy::kFeasible, config::Policy::kUrgency,
                                 config::Policy::kEdf, config::Policy::kSjf, config::Policy::kHrrn,
                                 config::Policy::kStatic, config::Policy::kFifo);
    Scheduler scheduler;
    scheduler.policy = policy;
    SlotView starved = task(1, -300ms, 0.5, -250ms), longer = task(2, -400ms, 0.5, -350ms);
    starved.state.starved = longer.state.starved = true;
    const SlotView in_time = task(0, 1ms, 1.0, 2ms);
    CHECK(decide_for(in_time, {starved, longer}, scheduler).rank == 2);
    CHECK_FALSE(decide_for(in_time, {starved, longer}, scheduler).admit);
    CHECK(decide_for(starved, {in_time, longer}, scheduler).rank == 1);
    CHECK(decide_for(longer, {in_time, starved}, scheduler).rank == 0);
    starved.state.demoted = true;  // as its config says
    CHECK(decide_for(starved, {in_time}, scheduler).rank == 1);
}

TEST_CASE("Passed over is overdue work of those that come before, and of no others",
          "[sched][admission]") {
    const auto overdue = [](SlotView v) {
        v.state.overdue = true;
        v.state.blocking = false;
        return v;
    };
    SlotView cleared = overdue(task(5, 3ms, 1.0));
    cleared.state.blocking = true;  // is being waited for
    const std::vector<SlotView> tasks{task(0, 10ms, 1.0),          overdue(task(1, 5ms, 1.0)),
                                      overdue(task(2, 20ms, 1.0)), task(3, 1ms, 1.0),
                                      overdue(task(63, 9ms, 1.0)), cleared};
    CHECK(sched::passed_over(kUrgency, {0ns, tasks}) == sched::TaskSet{1, 63});
}

TEST_CASE("The room that a launch-bound task leaves is used", "[sched][admission]") {
    const SlotView eager = launch_bound(1, 5ms, 1.0);
    CHECK(decide_for(launch_bound(0, 10ms, 1.0), {eager}, kUrgency).admit);
    CHECK(decide_for(task(0, 10ms, 0.7), {eager}, kUrgency).admit);
    CHECK_FALSE(decide_for(task(0, 10ms, 1.0), {eager}, kUrgency).admit);
    const SlotView three[] = {launch_bound(1, 5ms, 1.0), launch_bound(2, 6ms, 1.0),
                              launch_bound(3, 7ms, 1.0)};
    CHECK(decide_for(launch_bound(0, 10ms, 1.0), {three[0], three[1], three[2]}, kUrgency).admit);
    SlotView busier = task(4, 4ms, 0.5);
    CHECK_FALSE(
        decide_for(launch_bound(0, 10ms, 1.0), {three[0], three[1], busier}, kUrgency).admit);
}

TEST_CASE("A task whose launching is slowed down leaves more room", "[sched][admission]") {
    SlotView slower = launch_bound(1, 5ms, 1.0);  // a quarter of the GPU
    const auto admits = [&](int speed_pm, double utilization) {
        slower.launching.speed_pm = speed_pm;
        return decide_for(task(0, 10ms, utilization), {slower}, kUrgency).admit;
    };
    CHECK(admits(0, 0.8));  // as alone
    CHECK_FALSE(admits(0, 0.85));
    CHECK(admits(1000, 0.8));
    CHECK_FALSE(admits(1000, 0.85));
    CHECK(admits(500, 0.9));
    CHECK_FALSE(admits(500, 0.95));
    // The same of the task that asks.
    SlotView asks = launch_bound(0, 10ms, 1.0);
    CHECK_FALSE(decide_for(asks, {task(1, 5ms, 0.85)}, kUrgency).admit);
    asks.launching.speed_pm = 500;
    CHECK(decide_for(asks, {task(1, 5ms, 0.85)}, kUrgency).admit);
}

TEST_CASE("A launch-bound task that has much on the GPU leaves no room", "[sched][admission]") {
    SlotView eager = launch_bound(1, 5ms, 1.0);
    eager.ahead.launched = 2ms;
    CHECK_FALSE(decide_for(launch_bound(0, 10ms, 1.0), {eager}, kUrgency).admit);
    // Nor does a launch that takes long by itself fit into it.
    SlotView large = launch_bound(0, 10ms, 1.0);
    large.next = 2ms;
    CHECK_FALSE(decide_for(large, {launch_bound(1, 5ms, 1.0)}, kUrgency).admit);
}

TEST_CASE("Who is late holds nobody up, unless it has waited for too long", "[sched][admission]") {
    SlotView late = task(1, -1ms, 1.0, 10ms);
    const SlotView later = task(0, -5ms, 1.0, 20ms);
    CHECK(decide_for(later, {late}, kUrgency).admit);
    CHECK_FALSE(decide_for(later, {late, task(2, 5ms, 1.0)}, kUrgency).admit);
    late.state.starved = true;
    CHECK_FALSE(decide_for(later, {late}, kUrgency).admit);
}
