// SPDX-License-Identifier: Apache-2.0
//
// Tasks over several streams.
#include "tests/support/streams_fixture.h"

using namespace urgengo::testing;
using urgengo::exec::StreamFlavor;
namespace abi = urgengo::abi;
namespace runtime = urgengo::runtime;

TEST_CASE("Runtime ends a segment at the join of a fork, frame by frame", "[runtime][streams]") {
    StreamsFixture f;
    f.begin(f.thread_a, "tight");
    for (int frame = 0; frame < 3; ++frame) {
        f.fork(4);
        f.launch_on_sides(4, 2);
        CHECK_FALSE(f.closes(kTrunk));
        CHECK_FALSE(f.closes(side(3)));  // where the last launch went
        CHECK_FALSE(f.closes(joined(3)));
        f.join(4);
        CHECK_FALSE(f.closes(side(3)));
        CHECK(f.closes(kTrunk));
        f.wait(f.thread_a, kTrunk);
    }
}

TEST_CASE("Runtime ends a segment at the event behind a join", "[runtime][streams]") {
    StreamsFixture f;
    const auto end = reinterpret_cast<CUevent>(0xeff);
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a, kTrunk);
    f.fork(2);
    f.launch_on_sides(2, 1);
    f.record(end, kTrunk);
    CHECK_FALSE(f.closes(end));
    f.join(2);
    CHECK_FALSE(f.closes(end));
    f.record(end, kTrunk);
    CHECK(f.closes(end));
    f.rt().work_on_streams().event_destroyed(end);
    CHECK_FALSE(f.closes(end));
}

TEST_CASE("Runtime ends a segment when one stream after the other was waited for",
          "[runtime][streams]") {
    StreamsFixture f;
    f.begin(f.thread_a, "tight");
    f.launch_on_sides(3, 2);
    f.wait(f.thread_a, side(0));
    CHECK_FALSE(f.closes(side(2)));
    f.wait(f.thread_a, side(1));
    CHECK(f.closes(side(2)));
}

TEST_CASE("Runtime believes no join within a capture", "[runtime][streams]") {
    StreamsFixture f;
    f.begin(f.thread_a, "tight");
    f.launch_on_sides(2, 1);
    f.rt().streams().capture_begins(side(0), StreamFlavor::kLegacy);
    f.driver.capturing = side(0);
    f.join(1);
    f.driver.capturing = nullptr;
    f.rt().streams().capture_ended(side(0), StreamFlavor::kLegacy);
    f.record(joined(1), side(1));
    f.wait_for(kTrunk, joined(1));
    CHECK_FALSE(f.closes(kTrunk));
    f.join(1);
    CHECK(f.closes(kTrunk));
}

TEST_CASE("Runtime takes no new stream for a destroyed one", "[runtime][streams]") {
    StreamsFixture f;
    f.begin(f.thread_a, "tight");
    f.launch_on_sides(2, 1);
    f.rt().work_on_streams().destroyed(side(0));
    f.launch(f.thread_a, side(0));
    f.join(2);
    CHECK_FALSE(f.closes(kTrunk));  // what was on the old one has not been waited for
    f.wait(f.thread_a, nullptr, abi::TraceWait::kContext);
    f.launch(f.thread_a, side(0));
    CHECK(f.closes(side(0)));
}

TEST_CASE("Runtime marks a fork only where the program's order puts all before the mark",
          "[runtime][streams]") {
    StreamsFixture f;
    f.begin_beside_loose();
    f.driver.marks.clear();
    f.launch(f.thread_a, kTrunk);
    f.fork(4);
    f.launch_on_sides(4, 1);
    f.launch(f.thread_a, side(0));
    f.launch(f.thread_a, side(1));
    const int before = f.marks();
    f.launch_on_sides(4, 2);
    CHECK(f.marks() == before);  // none vouches for all
    f.join(4);
    CHECK(f.marks_on(kTrunk) == 0);
    SECTION("at the wait for it") {
        CHECK(f.begin_wait(f.thread_a, kTrunk).for_all);
        CHECK(f.marks_on(kTrunk) == 1);
    }
    SECTION("before the next launch on the trunk") {
        f.launch(f.thread_a, kTrunk);
        CHECK(f.marks_on(kTrunk) >= 1);
    }
    CHECK(f.marks_on(side(3)) == 0);
}

TEST_CASE("Runtime schedules launches of the plan on every branch", "[runtime][streams]") {
    StreamsFixture f;
    f.begin(f.thread_a, "tight");
    f.fork(4);
    f.launch_on_sides(4, 2);
    f.join(4);
    f.wait(f.thread_a, kTrunk);
    CHECK(f.stats(0).tasks.scheduled.load() == 8);
}

TEST_CASE("Runtime forgets a fork whose end nobody was seen to wait for, one run later",
          "[runtime][streams]") {
    StreamsFixture f;
    for (CUstream stream : {side(0), kTrunk, kTrunk}) {
        f.begin(f.thread_a, "tight");
        f.launch(f.thread_a, stream);
        const bool is_second = stream == kTrunk && f.stats(0).frames.instances.load() == 2;
        CHECK(f.closes(stream) == !is_second);
        f.rt().frames().task_end(f.thread_a);
    }
}

TEST_CASE("Runtime ends instances at the main stream's wait when nobody waits for the side stream",
          "[runtime][streams]") {
    StreamsFixture f;
    const ThreadName name("th_tight");
    const auto frame = [&] {
        f.clock.advance(10ms);
        f.launch(f.thread_a, kTrunk);
        f.launch(f.thread_a, side(0));  // it logs, and nothing joins it
        f.launch(f.thread_a, kTrunk);
        const bool closes = f.begin_wait(f.thread_a, kTrunk).for_all;
        f.wait(f.thread_a, kTrunk);
        return closes;
    };
    for (int i = 0; i < 3; ++i) frame();
    const auto ended = f.stats(0).frames.finished.load();
    for (int i = 0; i < 5; ++i) CHECK(frame());
    CHECK(f.stats(0).frames.finished.load() == ended + 5);
    // Until it joins again.
    f.launch(f.thread_a, kTrunk);
    f.fork(1);
    f.launch_on_sides(1, 2);
    f.join(1);
    f.launch(f.thread_a, kTrunk);
    f.wait(f.thread_a, kTrunk);
    CHECK_FALSE(frame());
}

TEST_CASE("Runtime ends no segment at the main stream's wait before the side stream's",
          "[runtime][streams]") {
    StreamsFixture f;
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 6; ++i) {
        f.launch(f.thread_a, kTrunk);
        f.launch(f.thread_a, side(0));
        f.launch(f.thread_a, kTrunk);
        CHECK_FALSE(f.begin_wait(f.thread_a, kTrunk).for_all);
        f.wait(f.thread_a, kTrunk);
        f.wait(f.thread_a, side(0));
    }
}

TEST_CASE("Runtime says once of a task that it uses more streams than it follows",
          "[runtime][streams]") {
    StreamsFixture f;
    f.begin(f.thread_a, "tight");
    const auto said = [&] {
        int n = 0;
        for (const std::string& line : f.rt().report().warnings())
            n += line.find("'detect' of chain 'tight' uses more than 16 streams") !=
                 std::string::npos;
        return n;
    };
    f.launch_on_sides(16, 1);
    CHECK(said() == 0);
    f.launch(f.thread_a, side(16));
    f.launch(f.thread_a, side(17));
    CHECK(said() == 1);
}
