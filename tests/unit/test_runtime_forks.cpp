// SPDX-License-Identifier: Apache-2.0
//
// Between the fork and the join of a task over several streams: marks of branches, run-ahead, and
// priorities.
#include "tests/support/streams_fixture.h"

using namespace urgengo::testing;

TEST_CASE("Runtime paces a long fork by marks on its branches", "[runtime][streams]") {
    StreamsFixture f;
    f.begin_beside_loose();
    f.fork(4);
    f.launch_on_sides(4, 2);
    CHECK(f.clock.num_sleeps == 0);  // 0.8 ms, the run-ahead is 1 ms
    CHECK(f.branch_marks() > 0);
    f.clock.on_sleep = [&] { f.driver.execute_marks(1); };
    for (int i = 0; i < 40; ++i) {
        f.launch(f.thread_a, side(i % 4));
        CHECK(f.branch_marks() <= 10);  // one for 0.2 ms
    }
    CHECK(f.clock.num_sleeps >= 10);
}

TEST_CASE("Runtime does not pace a fork once nothing is under way that tells how far it is",
          "[runtime][streams]") {
    StreamsFixture f;
    f.resolved.config.scheduler.run_ahead.limit = 150us;
    f.begin_beside_loose();
    f.fork(6);
    f.driver.execute_marks(100);
    const auto begin = f.clock.now();
    f.launch_on_sides(6, 1);  // 0.1 ms on each, which is no distance between marks
    CHECK(f.branch_marks() == 0);
    CHECK(f.clock.now() - begin < 1ms);
}

TEST_CASE("Runtime keeps two kernels of a fork on the GPU, however long they are",
          "[runtime][streams]") {
    StreamsFixture f;
    f.resolved.config.scheduler.run_ahead.limit = 50us;  // a kernel takes 100
    f.resolved.config.scheduler.progress.mark_every = 50us;
    f.begin_beside_loose();
    f.fork(2);
    f.launch(f.thread_a, side(0));
    f.driver.execute_marks(100);
    int launched = 0;
    f.clock.on_sleep = [&] {
        if (launched > 2) CHECK(f.branch_marks() >= 2);  // behind each kernel but the first
        f.driver.execute_marks(1);
    };
    for (; launched < 20; ++launched) f.launch(f.thread_a, side(launched % 2));
    CHECK(f.clock.num_sleeps >= 10);
}

TEST_CASE("Runtime paces a fork no more that stands still", "[runtime][streams]") {
    StreamsFixture f;
    f.begin_beside_loose();
    f.fork(4);
    const auto begin = f.clock.now();
    f.launch_on_sides(4, 10);  // 4 ms, of which nothing executes before all is launched
    CHECK(f.branch_marks() > 0);
    CHECK(f.clock.now() - begin > 1ms);
    CHECK(f.clock.now() - begin < 5ms);
}

TEST_CASE("Runtime marks no branch of a short fork", "[runtime][streams]") {
    StreamsFixture f;
    f.begin_beside_loose();
    f.launch(f.thread_a, kTrunk);
    for (int i = 0; i < 10; ++i) {
        f.fork(2);
        f.launch_on_sides(2, 1);
        f.join(2);
        f.launch(f.thread_a, kTrunk);
        f.driver.execute_marks(100);
    }
    CHECK(f.branch_marks() == 0);
    CHECK(f.clock.num_sleeps == 0);
}

TEST_CASE("Runtime does not pace a fork for what no mark can show", "[runtime][streams]") {
    StreamsFixture f;
    f.begin_beside_loose();
    const int streams = GENERATE(4, 8);  // more than have a place in the task's line
    f.fork(streams);
    f.launch_on_sides(streams, streams == 4 ? 2 : 1);
    if (streams == 4) {
        REQUIRE(f.branch_marks() > 0);  // which stay under way
        f.driver.launch_result = CUDA_ERROR_UNKNOWN;
    }
    const auto begin = f.clock.now();
    f.launch_on_sides(streams, 5);  // at least 2 ms, the run-ahead is 1 ms
    CHECK(f.clock.now() - begin < 1ms);
}

TEST_CASE("Runtime leaves the highest priority to who comes while a fork is far ahead",
          "[runtime][streams]") {
    StreamsFixture f;
    f.begin(f.thread_a, "tight");
    f.fork(4);
    CHECK(f.launch(f.thread_a, side(0)).priority == -5);
    CHECK(f.launch(f.thread_a, side(1)).priority == -5);
    f.launch_on_sides(4, 3);  // 1.4 ms
    CHECK(f.launch(f.thread_a, side(0)).priority == -2);
    f.join(4);
    CHECK(f.launch(f.thread_a, kTrunk).priority == -5);
}

TEST_CASE("Runtime has a fork go before a less urgent one that is far ahead",
          "[runtime][streams]") {
    StreamsFixture f;
    f.resolved.config.scheduler.admission = urgengo::config::Admission::kNone;
    const auto last_of_fork = [&](ThreadState& thread, int first_stream) {
        int priority = 0;
        for (int i = 0; i < 24; ++i)
            priority = f.launch(thread, side(first_stream + i % 4)).priority;
        return priority;
    };
    f.begin(f.thread_b, "loose");
    CHECK(last_of_fork(f.thread_b, 0) == -2);
    f.begin(f.thread_a, "tight");
    CHECK(last_of_fork(f.thread_a, 4) == -4);  // a level is left in between
    CHECK(f.launch(f.thread_b, side(0)).priority == -2);
    f.driver.execute_marks(100);
    f.rt().frames().task_end(f.thread_a);  // it has gone, and what it overtook is still there
    f.begin(f.thread_a, "tight");
    CHECK(last_of_fork(f.thread_a, 4) == -4);
}

TEST_CASE("Runtime takes a long fork to need no more time than it does", "[runtime][streams]") {
    StreamsFixture f;
    f.resolved.config.scheduler.run_ahead.limit = 10ms;
    f.begin_beside_loose();
    f.fork(4);
    f.launch_on_sides(4, 5);  // 2 ms, all of it
    f.driver.execute_marks(100);
    f.see_two_ms_go_by();
    CHECK(f.remaining_of_a() == 0us);
}

TEST_CASE("Runtime remembers a fork that is yet to begin when more comes behind its join",
          "[runtime][streams]") {
    StreamsFixture f;
    f.resolved.config.scheduler.run_ahead.limit = 10ms;
    f.begin_beside_loose();
    for (int i = 0; i < 20; ++i) f.launch(f.thread_a, kTrunk);
    f.fork(4);
    f.launch_on_sides(4, 5);
    f.join(4);
    const std::atomic<std::int64_t>& word = f.thread_a.task->slot->unmarked_until;
    REQUIRE(word != 0);
    REQUIRE(f.marks_on(kTrunk) > 0);  // that the fork is behind
    // Marks come behind the join, too, before any before it was seen executed.
    for (int i = 0; i < 40; ++i) f.launch(f.thread_a, kTrunk);
    REQUIRE(f.marks_on(kTrunk) > 1);
    CHECK(word != 0);
    f.driver.execute_marks(100);
    CHECK(f.remaining_of_a() >= 0us);  // which looks at marks
    f.launch(f.thread_a, kTrunk);
    CHECK(word == 0);
}

TEST_CASE("Runtime has a fork get on by time while the mark behind its join is still to come",
          "[runtime][streams]") {
    const int behind = GENERATE(0, 4);  // launches of 100 us
    StreamsFixture f;
    f.resolved.config.scheduler.run_ahead.limit = 10ms;
    f.begin_beside_loose();
    f.fork(4);
    f.launch_on_sides(4, 5 - behind / 4);  // with those behind the join 2 ms
    f.driver.execute_marks(100);
    f.join(4);
    for (int i = 0; i < behind; ++i) f.launch(f.thread_a, kTrunk);
    f.begin_wait(f.thread_a, kTrunk);
    REQUIRE(f.marks_on(kTrunk) > 0);
    f.see_two_ms_go_by();
    CHECK(f.remaining_of_a() <= behind * 100us);
    f.driver.execute_marks(100);
    CHECK(f.remaining_of_a() == 0us);
}
