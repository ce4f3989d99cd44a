// SPDX-License-Identifier: Apache-2.0
//
// Those that slow each other's launching launch in turn (host/sched/admission.h).
#include <vector>

#include "host/sched/admission.h"
#include "tests/support/catch.h"
#include "tests/support/slot_views.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
using config::Scheduler;
using model::SlotView;

TEST_CASE("Of those that slow each other's launching, two launch at a time",
          "[sched][admission][launching]") {
    const SlotView first = slowed(1, 5ms), second = slowed(2, 6ms), third = slowed(3, 50ms);
    CHECK(decide_for(slowed(0, 10ms), {first, third}, kUrgency).admit);
    const auto d = decide_for(slowed(0, 10ms), {first, second}, kUrgency);
    CHECK_FALSE(d.admit);
    CHECK(d.launches_late);
    CHECK(d.rank == 2);

    Scheduler scheduler = kUrgency;
    scheduler.packing.launchers = 1;
    CHECK_FALSE(decide_for(slowed(0, 10ms), {first, third}, scheduler).admit);
    scheduler.packing.launchers = 0;
    CHECK(decide_for(slowed(0, 10ms), {first, second}, scheduler).admit);
    scheduler = kUrgency;
    scheduler.admission = config::Admission::kNone;
    CHECK(decide_for(slowed(0, 10ms), {first, second}, scheduler).admit);
}

TEST_CASE("Whose launching nobody slows, or who slows nobody's, is not waited for",
          "[sched][admission][launching]") {
    const SlotView first = slowed(1, 5ms), second = slowed(2, 6ms);
    CHECK(decide_for(launch_bound(0, 10ms, 0.1), {first, second}, kUrgency).admit);

    SlotView free = first, done = first, unknown = first;
    free.launching.slowed = model::Launching::kFree;
    done.launching.is_next = false;  // all is launched: it waits for the GPU
    unknown.launching.slowed = model::Launching::kUnknown;
    CHECK(decide_for(slowed(0, 10ms), {free, second}, kUrgency).admit);
    CHECK(decide_for(slowed(0, 10ms), {done, second}, kUrgency).admit);
    CHECK_FALSE(decide_for(slowed(0, 10ms), {unknown, second}, kUrgency).admit);
}

TEST_CASE("It is told that a launch may go only as those before it pause",
          "[sched][admission][launching]") {
    const SlotView first = slowed(1, 5ms), second = slowed(2, 6ms);
    SlotView paused = second, behind = slowed(2, 50ms);
    paused.launching.is_next = behind.launching.is_next = false;
    paused.launching.pauses = behind.launching.pauses = true;
    const auto pause = [&](const std::vector<SlotView>& others) {
        return decide_for(slowed(0, 10ms), others, kUrgency).others_pause;
    };
    CHECK(pause({first, paused}));
    CHECK_FALSE(pause({first, second}));  // it may not go
    CHECK_FALSE(pause({first, behind}));
    CHECK_FALSE(pause({paused}));  // there was room for it
    paused.launching.slowed = model::Launching::kFree;
    CHECK_FALSE(pause({first, paused}));
}

TEST_CASE("Beside a busy bystander they launch in turn, and are held for nothing else",
          "[sched][admission][launching]") {
    Scheduler alone = kUrgency;
    alone.admission = config::Admission::kNone;
    const std::vector<SlotView> tasks{slowed(0, 10ms), slowed(1, 5ms), slowed(2, 6ms)};
    sched::Snapshot snapshot{0ns, tasks};
    CHECK(sched::decide(alone, snapshot).admit);
    snapshot.takes_turns = true;
    const sched::Decision waits = sched::decide(alone, snapshot);
    CHECK_FALSE(waits.admit);
    CHECK_FALSE(waits.is_free);
    CHECK(waits.why == sched::Why::kTurnToLaunch);
    CHECK(waits.blocker == 1);
    snapshot.tasks = std::span(tasks).first(2);
    CHECK(sched::decide(alone, snapshot).admit);
}

TEST_CASE("Other admissions know nothing of launching in turn", "[sched][admission][launching]") {
    const std::vector<SlotView> two{slowed(1, 5ms), slowed(2, 6ms)};
    Scheduler scheduler = kUrgency;
    scheduler.admission = config::Admission::kThreshold;
    CHECK_FALSE(decide_for(slowed(0, 10ms), two, scheduler).launches_late);
    scheduler.admission = config::Admission::kExclusive;
    CHECK_FALSE(decide_for(slowed(0, 10ms), {two[0]}, scheduler).launches_late);
}

TEST_CASE("Late ones launch in turn, too", "[sched][admission][launching]") {
    const SlotView first = slowed(1, -5ms), second = slowed(2, -4ms);
    CHECK_FALSE(decide_for(slowed(0, -3ms), {first, second}, kUrgency).admit);
}
