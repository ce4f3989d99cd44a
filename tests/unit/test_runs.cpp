// SPDX-License-Identifier: Apache-2.0
//
// Who is at a task, and whose run it is.
#include "host/runtime/runs.h"

#include "tests/support/runs_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using runtime::Runs;

namespace {

struct RunsTest : RunsFixture {
    runtime::TaskState& task = tight();
    void begin_a() { begin_run(thread_a, task); }
};

}  // namespace

TEST_CASE("One thread at a time is at a task", "[runtime][runs]") {
    RunsTest f;
    REQUIRE(f.runs.take(f.thread_a, f.task));
    CHECK(f.thread_a.at_task == &f.task);
    CHECK_FALSE(f.runs.take(f.thread_b, f.task));
    CHECK_FALSE(f.runs.take(f.task));
    f.runs.release(f.thread_a);
    CHECK(f.thread_a.at_task == nullptr);
    REQUIRE(f.runs.take(f.task));
    CHECK_FALSE(f.runs.take(f.thread_b, f.task));
    f.runs.let_go(f.task);
    CHECK(f.runs.take(f.thread_b, f.task));
}

TEST_CASE("Who takes a task finds its unasked launches counted", "[runtime][runs]") {
    RunsTest f;
    f.begin_a();
    f.task.slot->as_planned = 3;
    f.task.log.launched(100us, {.time = f.clock.now()});
    REQUIRE(f.runs.take(f.thread_b, f.task));
    CHECK(f.task.run.position == 3);
}

TEST_CASE("A run is its owner's from begin() to end()", "[runtime][runs]") {
    RunsTest f;
    f.begin_a();
    CHECK(Runs::own_task(f.thread_a) == &f.task);
    CHECK(f.task.slot->state == abi::TaskState::kCpu);
    CHECK_FALSE(f.runs.claim(f.thread_b, f.task));
    CHECK(f.task.slot->deadline_ns == (f.clock.now() + 20ms).count());
    f.runs.end(f.thread_a, f.task);
    CHECK(Runs::own_task(f.thread_a) == nullptr);
    CHECK(f.task.slot->state == abi::TaskState::kIdle);
    CHECK(f.runs.claim(f.thread_b, f.task));
}

TEST_CASE("Whoever is at a task when its run ends, ends it when it lets go", "[runtime][runs]") {
    RunsTest f;
    f.begin_a();
    REQUIRE(f.runs.take(f.thread_b, f.task));
    f.runs.end(f.thread_a, f.task);
    CHECK(f.task.slot->state == abi::TaskState::kCpu);
    CHECK_FALSE(f.runs.claim(f.thread_a, f.task));
    f.runs.release(f.thread_b);
    CHECK(f.task.slot->state == abi::TaskState::kIdle);
    CHECK(f.runs.claim(f.thread_a, f.task));
}

TEST_CASE("A run that was left lying may be ended by others, after long", "[runtime][runs]") {
    RunsTest f;
    REQUIRE(f.runs.claim(f.thread_a, f.task));
    f.runs.begin(f.thread_a, f.task, f.clock.now(), f.clock.now(), false);
    f.runs.end_abandoned(f.thread_b, f.task, f.clock.now() + 1600ms);
    CHECK(Runs::own_task(f.thread_a) == &f.task);
    f.runs.end_abandoned(f.thread_b, f.task, f.clock.now() + 1601ms);
    CHECK(Runs::own_task(f.thread_a) == nullptr);
}

TEST_CASE("No run is left once all were ended", "[runtime][runs]") {
    RunsTest f;
    f.begin_a();
    SECTION("of a task that is free") {
        f.runs.end_all();
        CHECK(f.task.slot->state == abi::TaskState::kIdle);
        CHECK(f.runs.claim(f.thread_b, f.task));
    }
    SECTION("of one that a thread is at, once it lets go") {
        REQUIRE(f.runs.take(f.thread_b, f.task));
        f.runs.end_all();
        CHECK(f.task.slot->state == abi::TaskState::kCpu);
        f.runs.release(f.thread_b);
        CHECK(f.task.slot->state == abi::TaskState::kIdle);
    }
    SECTION("but one that a thread is about to begin stays its own") {
        f.runs.end(f.thread_a, f.task);
        f.task.taking.owner = &f.thread_b;  // the first half of a claim
        f.runs.end_all();
        CHECK(f.task.taking.owner == &f.thread_b);
        f.task.taking.owner = nullptr;
        f.begin_run(f.thread_b, f.task);
        CHECK(Runs::own_task(f.thread_b) == &f.task);
    }
    CHECK_FALSE(f.task.taking.end_is_due.load());
}

TEST_CASE("A thread that does not come back leaves no task taken", "[runtime][runs]") {
    RunsTest f;
    f.begin_a();
    REQUIRE(f.runs.take(f.thread_a, f.task));
    f.task.taking.held_frame = &f;
    SECTION("as it has jumped out of a hold") {
        f.task.slot->state = abi::TaskState::kHeld;
        CHECK(f.runs.jumped_out_of_hold(f.thread_a));
        CHECK(f.task.slot->state == abi::TaskState::kGpu);
        CHECK_FALSE(f.runs.jumped_out_of_hold(f.thread_a));
    }
    SECTION("as it was cancelled") {
        f.runs.thread_ends(f.thread_a);
    }
    CHECK(f.task.taking.held_frame == nullptr);
    CHECK(f.runs.take(f.thread_b, f.task));
}
