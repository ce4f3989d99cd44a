// SPDX-License-Identifier: Apache-2.0
//
// Tasks over several streams.
#include "tests/support/runtime_fixture.h"

using namespace urgengo::testing;
using urgengo::exec::StreamFlavor;
namespace abi = urgengo::abi;
namespace runtime = urgengo::runtime;

namespace {

const CUstream kTrunk = kStreamA;
const CUevent kFork = reinterpret_cast<CUevent>(0xe00);

CUstream side(int i) {
    return reinterpret_cast<CUstream>(static_cast<std::uintptr_t>(0x1000 + 0x10 * i));
}
CUevent joined(int i) {
    return reinterpret_cast<CUevent>(static_cast<std::uintptr_t>(0xe10 + 0x10 * i));
}

struct StreamsFixture : RuntimeFixture {
    void record(CUevent event, CUstream stream) {
        rt().waits().event_recorded(thread_a, event, stream, StreamFlavor::kLegacy, false);
    }
    void wait_for(CUstream stream, CUevent event) {
        rt().work_on_streams().stream_waits(thread_a, stream, StreamFlavor::kLegacy, event);
    }
    void fork(int streams) {
        record(kFork, kTrunk);
        for (int i = 0; i < streams; ++i) wait_for(side(i), kFork);
    }
    void join(int streams) {
        for (int i = 0; i < streams; ++i) {
            record(joined(i), side(i));
            wait_for(kTrunk, joined(i));
        }
    }
    void launch_on_sides(int streams, int each) {
        for (int k = 0; k < each; ++k)
            for (int i = 0; i < streams; ++i) launch(thread_a, side(i));
    }
    /// `loose` is at work, so that `tight` has company, and `tight` begins.
    void begin_beside_loose() {
        begin(thread_b, "loose");
        launch(thread_b, kStreamB);
        begin(thread_a, "tight");
    }
    bool closes(CUstream stream) { return begin_wait(thread_a, stream).for_all; }
    bool closes(CUevent event) {
        runtime::Wait wait;
        wait.function = abi::TraceWait::kEvent;
        wait.event = event;
        rt().waits().before(thread_a, wait);
        return wait.for_all;
    }
    std::chrono::nanoseconds remaining_of_a() {
        const runtime::TaskState& task = *thread_a.task;
        return urgengo::model::read_slot(*task.slot, task.line.load(), task.index, clock.now())
            .remaining.gpu;
    }
    /// While 2 ms of work go by time: all of it is left at first, half of it after half.
    void see_two_ms_go_by() {
        CHECK(remaining_of_a() > std::chrono::microseconds(1900));
        clock.advance(std::chrono::milliseconds(1));
        CHECK(remaining_of_a() > std::chrono::microseconds(900));
        CHECK(remaining_of_a() <= std::chrono::milliseconds(1));
        clock.advance(std::chrono::milliseconds(1));
    }
    /// Marks that are under way and were launched on `stream`.
    int marks_on(CUstream stream) const {
        int n = 0;
        for (const PendingMark& m : driver.marks) n += m.stream == stream;
        return n;
    }
};

}  // namespace

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
    const auto before = f.driver.marks.size();
    f.launch_on_sides(4, 2);
    CHECK(f.driver.marks.size() == before);  // none vouches for all
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

TEST_CASE("Runtime does not pace a fork for what no mark can show", "[runtime][streams]") {
    StreamsFixture f;
    f.begin_beside_loose();
    f.fork(4);
    const auto begin = f.clock.now();
    f.launch_on_sides(4, 5);  // 2 ms, the run-ahead is 1 ms
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

TEST_CASE("Runtime takes a long fork to need no more time than it does", "[runtime][streams]") {
    StreamsFixture f;
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
