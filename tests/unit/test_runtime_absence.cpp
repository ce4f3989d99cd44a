// SPDX-License-Identifier: Apache-2.0
//
// Loans as the whole runtime makes them.
#include "host/sched/absence.h"

#include <memory>

#include "tests/support/catch.h"
#include "tests/support/other_thread.h"
#include "tests/support/runtime_fixture.h"

namespace urgengo::testing {
namespace {

// `third` fills the GPU and is more urgent than `loose`, which is held for it; `tight` comes every
// 20 ms, as a thread that waits for a lock which `loose` holds would not.
struct Locked : RuntimeFixture {
    ThreadState thread_c;
    Locked() {
        config::Chain third = resolved.config.chains[0];
        third.name = "third";
        third.deadline = 10s;
        third.tasks[0].thread_glob = "th_third";
        resolved.config.chains.push_back(third);
        resolved.profile->chains.push_back({"third", {profile_of("detect", 2000, 100us, 1.0)}});
        resolved.config.chains[0].period = 20ms;
        resolved.config.chains[1].deadline = 20s;
        resolved.config.scheduler.policy = config::Policy::kEdf;
        resolved.config.scheduler.hold.max_per_instance = 200ms;
    }
    void frame_of_tight() { frame_of_tight(thread_a); }
    void frame_of_tight(ThreadState& thread) {
        begin(thread, "tight");
        launch(thread);
        driver.execute_marks(100);
        rt().frames().task_end(thread);
    }
    /// `loose` launches while `third` keeps the GPU full. @returns for how long it is held
    nanoseconds hold_loose() {
        begin(thread_c, "third");
        for (int i = 0; i < 8; ++i) launch(thread_c, kStreamB);
        begin(thread_b, "loose");
        const nanoseconds begin_ns = clock.now();
        clock.on_sleep = [&] {
            // Its work goes on: it is never overdue.
            abi::TaskSlot& slot = *thread_c.task->slot;
            slot.progress_ns = slot.launch_ns = slot.look_ns = clock.now().count();
        };
        const Grant grant = launch(thread_b);
        REQUIRE(grant.scheduled);
        priority = grant.priority;
        clock.on_sleep = nullptr;
        return clock.now() - begin_ns;
    }
    int priority = 0;
};

}  // namespace

TEST_CASE("Runtime ends holds while a more urgent chain's frame does not come",
          "[runtime][absence]") {
    Locked f;
    f.frame_of_tight();
    const nanoseconds held = f.hold_loose();  // the next frame is due in 20 ms
    CHECK(held >= 20ms);
    CHECK(held <= 23ms);
    CHECK(f.priority == 0);  // the least
    CHECK(f.stats(1).tasks.lent == 1);
    CHECK(f.stats(1).tasks.holds_opened == 0);
}

TEST_CASE("Runtime ends holds later for a thread that goes on by itself, as it may spin",
          "[runtime][absence]") {
    using Does = OtherThread::Does;
    for (const auto& [does, at] : {std::pair{Does::kSpin, 30ms}, std::pair{Does::kSleep, 30ms},
                                   std::pair{Does::kWaitForLock, 20ms}}) {
        Locked f;
        const OtherThread other(does);
        runtime::ThreadLine line;
        ThreadState tight(line, other.id());
        f.frame_of_tight(tight);
        const nanoseconds held = f.hold_loose();
        CHECK(held >= at);
        CHECK(held <= at + 3ms);
        CHECK(f.stats(1).tasks.lent == 1);
    }
}

TEST_CASE("Runtime paces nobody while a chain's frame does not come, a less urgent one's, too",
          "[runtime][absence]") {
    Locked f;
    f.resolved.config.chains[1].period = 20ms;
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_b);
    f.driver.execute_marks(100);
    f.rt().frames().task_end(f.thread_b);
    f.clock.advance(15ms);
    f.begin(f.thread_a, "tight");
    const nanoseconds begin = f.clock.now();
    f.clock.on_sleep = [&] {  // its work goes on: it is never overdue
        abi::TaskSlot& slot = *f.thread_a.task->slot;
        slot.progress_ns = slot.launch_ns = slot.look_ns = f.clock.now().count();
    };
    // Nothing executes: it is paced, until 1 ms later than a held one is held.
    for (int i = 0; i < 100 && f.stats(0).tasks.lent == 0; ++i) f.launch(f.thread_a);
    CHECK(f.clock.now() - begin >= 5ms);
    CHECK(f.clock.now() - begin <= 9ms);
    CHECK(f.stats(0).tasks.lent == 1);
    CHECK(f.stats(0).tasks.holds == 0);
}

TEST_CASE("Runtime lends nothing for a camera that has stopped", "[runtime][absence]") {
    Locked f;
    f.frame_of_tight();
    f.clock.advance(100ms);
    CHECK(f.hold_loose() >= 200ms);  // the bound
    CHECK(f.stats(1).tasks.lent == 0);
}

TEST_CASE("Runtime has others make room for work that a more urgent chain waits for",
          "[runtime][lent_deadline]") {
    Locked f;
    const auto event = reinterpret_cast<CUevent>(0xe00);
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_b);
    f.begin(f.thread_c, "third");
    f.launch(f.thread_c, kStreamB);  // before `loose`
    CHECK(f.stats(2).tasks.holds == 0);
    f.rt().waits().event_recorded(f.thread_b, event, kStreamA, exec::StreamFlavor::kLegacy, false);
    f.begin_wait(f.thread_b, kStreamA);
    SECTION("while it does") {
        f.begin(f.thread_a, "tight");
    }
    SECTION("and has not begun when it begins to") {}
    f.rt().work_on_streams().stream_waits(f.thread_a, kStreamB, exec::StreamFlavor::kLegacy, event);
    if (!f.thread_a.task) f.begin(f.thread_a, "tight");
    int looks = 0;
    f.clock.on_sleep = [&] {
        if (++looks == 5) f.driver.execute_marks(100);
    };
    f.launch(f.thread_c, kStreamB);
    CHECK(looks == 5);
    f.clock.on_sleep = nullptr;
    CHECK(f.stats(2).tasks.holds == 1);
    CHECK(f.stats(2).tasks.lent == 0);
}

TEST_CASE("Runtime lends a deadline along a row of waits, whichever began first",
          "[runtime][lent_deadline]") {
    Locked f;
    const auto of_third = reinterpret_cast<CUevent>(0xe00);
    const auto of_loose = reinterpret_cast<CUevent>(0xe01);
    const auto last_of_third = reinterpret_cast<CUevent>(0xe02);
    const auto first_of_loose = reinterpret_cast<CUevent>(0xe03);
    const auto records = [&](ThreadState& thread, CUevent event, CUstream stream) {
        f.rt().waits().event_recorded(thread, event, stream, exec::StreamFlavor::kLegacy, false);
    };
    const auto waits = [&](ThreadState& thread, CUstream stream, CUevent event) {
        f.rt().work_on_streams().stream_waits(thread, stream, exec::StreamFlavor::kLegacy, event);
    };
    f.begin(f.thread_c, "third");
    f.launch(f.thread_c, kStreamB);
    records(f.thread_c, of_third, kStreamB);
    f.launch(f.thread_c, kStreamB);
    records(f.thread_c, last_of_third, kStreamB);
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_b);
    bool needs_third = true, is_early_awaited = false;
    SECTION("for work behind the wait, up to the last of them") {
        waits(f.thread_b, kStreamA, of_third);
        waits(f.thread_b, kStreamA, last_of_third);
        f.launch(f.thread_b);
        records(f.thread_b, of_loose, kStreamA);
    }
    SECTION("also if work before the wait was waited for first") {
        records(f.thread_b, first_of_loose, kStreamA);
        waits(f.thread_b, kStreamA, last_of_third);
        f.launch(f.thread_b);
        records(f.thread_b, of_loose, kStreamA);
        is_early_awaited = true;
    }
    SECTION("but not for work before it") {
        records(f.thread_b, of_loose, kStreamA);
        waits(f.thread_b, kStreamA, of_third);
        f.launch(f.thread_b);
        needs_third = false;
    }
    f.begin(f.thread_a, "tight");
    const abi::TaskSlot& third = *f.thread_c.task->slot;
    const abi::TaskSlot& loose = *f.thread_b.task->slot;
    const abi::TaskSlot& tight = *f.thread_a.task->slot;
    REQUIRE(third.lent_deadline_ns == 0);  // `loose` is less urgent than `third`
    if (is_early_awaited) waits(f.thread_a, kStreamB, first_of_loose);
    CHECK(third.lent_deadline_ns == 0);
    waits(f.thread_a, kStreamB, of_loose);
    CHECK(loose.lent_deadline_ns == tight.deadline_ns);
    CHECK(third.lent_deadline_ns == (needs_third ? tight.deadline_ns.load() : 0));
    if (needs_third) CHECK(third.lent_until_ns == third.launched_ns);
}

}  // namespace urgengo::testing
