// SPDX-License-Identifier: Apache-2.0
//
// Marks by events: their times, their poller, and what happens when there are none.
#include "tests/support/marks_driver.h"

using namespace urgengo;
using namespace urgengo::exec;
using namespace urgengo::testing;
using namespace urgengo::testing::marks;
using config::ProgressSource;
using namespace std::chrono_literals;

TEST_CASE("Events are published in order, with the host's time, once they are complete",
          "[exec][marks][event]") {
    Fixture f;
    f.prepare(ProgressSource::kEvent);
    CHECK(f.poller.num_starts == 1);
    CHECK(f.line().clock == UG_MARK_CLOCK_HOST);
    CHECK_FALSE(f.poller.look());
    CHECK(f.driver.num_queries == 0);
    // An event's time lies before the look that finds it complete, never before its record.
    const auto before = static_cast<std::uint64_t>(monotonic_now().count());
    for (int i = 0; i < 3; ++i) CHECK(f.emit() == CUDA_SUCCESS);
    CHECK(f.poller.num_wakes == 3);
    CHECK(f.driver.num_launches == 0);
    CHECK(f.poller.look());
    CHECK(f.done() == 0);
    f.complete(1);  // of another stream, say: it does not vouch for the first
    CHECK(f.poller.look());
    CHECK(f.done() == 0);
    f.complete(0);
    CHECK(f.poller.look());
    CHECK(f.done() == 2);
    const std::uint64_t age = ((f.line().word[1] >> 16) - before) & 0xffff'ffff'ffff;
    CHECK(age < 10'000'000'000);
    CHECK(f.line().word[0] == ug_mark_word0(7, 9, 2));
    CHECK(f.driver.current == f.driver.base.context);
    f.complete(2);
    CHECK_FALSE(f.poller.look());
    CHECK(f.done() == 3);
    CHECK(f.driver.current == nullptr);  // nothing is held on to
    CHECK_FALSE(f.driver.asked_unsafely);
    CHECK(f.driver.mode == CU_STREAM_CAPTURE_MODE_GLOBAL);
}

TEST_CASE("An event's time lies between the looks that it came between", "[exec][marks][event]") {
    EventFixture f;
    SECTION("of three, the last came after three quarters of the time") {
        for (int i = 0; i < 4; ++i) f.record();
        CHECK(f.look() == More::kSoon);
        CHECK(f.line().looked_ns == static_cast<std::uint64_t>(f.clock.now().count()));
        const auto first_look = f.clock.now();
        f.clock.advance(40us);
        for (std::size_t i = 0; i < 3; ++i) f.driver.complete[f.driver.order[i]] = true;
        CHECK(f.look() == More::kSoon);
        CHECK(f.line().word[0] == ug_mark_word0(0, 0, 3));
        CHECK(f.stamp() == first_look + 30us);
        CHECK(f.line().looked_ns == static_cast<std::uint64_t>(f.clock.now().count()));
    }
    SECTION("not before it was recorded") {
        f.record();
        f.driver.complete[f.driver.order[0]] = true;
        f.clock.advance(40us);
        CHECK(f.look() == More::kNone);
        f.clock.advance(10ms);
        const auto recorded = f.clock.now();
        f.record();
        f.clock.advance(30us);
        f.driver.complete[f.driver.order[1]] = true;
        CHECK(f.look() == More::kNone);
        CHECK(f.stamp() == recorded + 15us);
    }
}

TEST_CASE("Poller that loses its turn behind a question says when it asked",
          "[exec][marks][event]") {
    EventFixture f;
    f.record();
    const auto asked = f.clock.now();
    f.driver.on_query = [&] { f.clock.advance(4ms); };
    CHECK(f.look() == More::kSoon);
    CHECK(f.line().looked_ns == static_cast<std::uint64_t>(asked.count()));
    f.driver.on_query = nullptr;
    f.driver.complete[f.driver.order[0]] = true;
    f.clock.advance(2us);
    CHECK(f.look() == More::kNone);
    CHECK(f.stamp() == f.clock.now() - 100us);  // not too long ago: who knows
}

TEST_CASE("Poller is told whether anybody wants to know soon", "[exec][marks][event]") {
    EventFixture f;
    CHECK(f.look() == More::kNone);
    f.record(false);
    CHECK(f.look() == More::kLater);
    f.record(true);
    CHECK(f.look() == More::kSoon);
    f.record(false);  // the newest counts
    CHECK(f.look() == More::kLater);
    f.marks.watch();  // somebody has come, and waits for what is there
    CHECK(f.look() == More::kSoon);
    for (const CUevent event : f.driver.order) f.driver.complete[event] = true;
    CHECK(f.look() == More::kNone);
}

TEST_CASE("Full ring of events takes no mark, and is used again when it has emptied",
          "[exec][marks][event]") {
    Fixture f;
    f.prepare(ProgressSource::kEvent);
    for (std::uint32_t i = 0; i < EventContext::kRing; ++i) REQUIRE(f.emit() == CUDA_SUCCESS);
    CHECK(f.emit() == CUDA_ERROR_NOT_READY);
    CHECK(f.driver.order.size() == EventContext::kRing);
    CHECK(f.driver.num_events == EventContext::kRing);
    f.complete(0);
    CHECK(f.poller.look());
    CHECK(f.emit() == CUDA_SUCCESS);
    CHECK(f.driver.order.back() == f.driver.order.front());
    for (std::size_t i = 1; i < f.driver.order.size(); ++i) f.complete(i);
    CHECK_FALSE(f.poller.look());
    CHECK(f.done() == EventContext::kRing + 1);
    CHECK(f.driver.num_launches == 0);
}

TEST_CASE("Kernels mark instead, once and for all, when events cannot be had",
          "[exec][marks][event]") {
    Fixture f;
    SECTION("no thread") {
        f.poller.starts = false;
    }
    SECTION("no events") {
        f.driver.create_result = CUDA_ERROR_OUT_OF_MEMORY;
    }
    SECTION("a record is refused") {
        f.driver.record_result = CUDA_ERROR_INVALID_HANDLE;
    }
    SECTION("the driver cannot ask") {
        f.driver.base.api.cuEventQuery = nullptr;
    }
    f.prepare(ProgressSource::kEvent);
    CHECK(f.emit() == CUDA_SUCCESS);
    f.driver.record_result = CUDA_SUCCESS;
    CHECK(f.emit() == CUDA_SUCCESS);
    CHECK(f.driver.order.empty());
    CHECK(f.line().clock == UG_MARK_CLOCK_GPU);
    f.driver.base.execute_marks(2);
    CHECK(f.done() == 2);
    if (f.poller.look_ && f.poller.starts) CHECK_FALSE(f.poller.look());
    CHECK(f.driver.num_queries == 0);
}

TEST_CASE("Events of a lost context are asked for once", "[exec][marks][event]") {
    Fixture f;
    f.prepare(ProgressSource::kEvent);
    CHECK(f.emit() == CUDA_SUCCESS);
    f.driver.lost = CUDA_ERROR_ILLEGAL_ADDRESS;
    CHECK_FALSE(f.poller.look());
    CHECK_FALSE(f.poller.look());
    CHECK(f.driver.num_queries == 1);
    CHECK(f.done() == 0);
    CHECK(f.emit() == CUDA_SUCCESS);  // as far as this driver knows
    CHECK(f.driver.num_launches == 1);
}

TEST_CASE("Kernels mark instead when the poller has stopped", "[exec][marks][event]") {
    Fixture f;
    f.prepare(ProgressSource::kEvent);
    CHECK(f.emit() == CUDA_SUCCESS);
    f.poller.stopped = true;
    CHECK(f.emit() == CUDA_SUCCESS);
    CHECK(f.driver.num_launches == 1);
    f.driver.base.execute_marks(1);
    CHECK(f.done() == 2);
}

TEST_CASE("Events are not touched when their context goes", "[exec][marks][event]") {
    Fixture f;
    f.prepare(ProgressSource::kEvent);
    CHECK(f.emit() == CUDA_SUCCESS);
    CHECK(f.poller.look());
    CHECK(f.driver.num_queries == 1);
    bool goes = true;
    SECTION("by its handle") {
        f.marks->context_ends({f.driver.base.context, -1});
    }
    SECTION("with its device") {
        f.marks->context_ends({nullptr, 0});
    }
    SECTION("perhaps") {
        f.marks->context_ends({});
    }
    SECTION("not: another goes") {
        goes = false;
        f.marks->context_ends({reinterpret_cast<CUcontext>(0x43), -1});
        f.marks->context_ends({nullptr, 1});
    }
    CHECK(f.poller.look() == !goes);
    CHECK(f.driver.num_queries == (goes ? 1 : 2));
    CHECK(f.emit() == CUDA_SUCCESS);
    CHECK(f.driver.num_launches == (goes ? 1 : 0));
}

TEST_CASE("Poller's current context is set anew when another has come by its handle",
          "[exec][marks][event]") {
    Fixture f;
    static unsigned long long id = 0;
    f.driver.base.api.cuCtxGetId = [](CUcontext, unsigned long long* found) {
        *found = id;
        return CUDA_SUCCESS;
    };
    f.prepare(ProgressSource::kEvent);
    CHECK(f.emit() == CUDA_SUCCESS);
    CHECK(f.poller.look());
    CHECK(f.driver.current == f.driver.base.context);
    f.marks->context_ends({});
    f.driver.current = reinterpret_cast<CUcontext>(0xdead);
    const MarkContext* gone = f.context;
    ++id;
    f.context = f.marks->prepare();
    REQUIRE(f.context != gone);
    CHECK(f.emit() == CUDA_SUCCESS);
    CHECK(f.poller.look());
    CHECK_FALSE(f.driver.asked_unsafely);
    CHECK(f.driver.num_launches == 0);
    f.marks->context_ends({});
    CHECK_FALSE(f.poller.look());
    CHECK(f.driver.current == nullptr);  // a thread of ours keeps none that has gone
}

TEST_CASE("Poller's thread looks while there is something to see, sleeps and is woken",
          "[exec][event]") {
    // Never destroyed, as in a program.
    struct Shared {
        std::atomic<int> work{0};
        std::atomic<int> looks{0};
        PollerThread poller;
    };
    Shared& shared = *new Shared;
    REQUIRE(shared.poller.start([&shared] {
        ++shared.looks;
        int work = shared.work;
        if (work > 0) shared.work = work - 1;
        return work > 1 ? More::kSoon : More::kNone;
    }));
    const auto reaches = [&](const auto& state) {
        const auto until = monotonic_now() + 10s;
        while (!state() && monotonic_now() < until) std::this_thread::yield();
        return state();
    };
    for (int round = 0; round < 50; ++round) {
        shared.work = 3;
        shared.poller.wake();
        REQUIRE(reaches([&] { return shared.work == 0; }));
        if (round % 10 != 0) continue;
        // With nothing to see it stops looking.
        int looks = -1;
        REQUIRE(reaches([&] {
            const int last = looks;
            looks = shared.looks;
            SteadyClock().sleep_for(5ms);
            return last == shared.looks;
        }));
    }
}
