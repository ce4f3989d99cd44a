// SPDX-License-Identifier: Apache-2.0
#include "host/sched/absence.h"

#include <memory>

#include "host/sched/admission.h"
#include "tests/support/catch.h"
#include "tests/support/runtime_fixture.h"

namespace urgengo::testing {
namespace {

using sched::Expectation;
using sched::Jitter;
using std::chrono::nanoseconds;

constexpr nanoseconds kPeriod = 20ms, kDeadline = 15ms, kStart = 10s;

/// Frames that come every 20 ms and launch at once; so many.
struct Frames {
    Expectation expectation;
    nanoseconds last = kStart - kPeriod;
    int late = 0;

    explicit Frames(int count) {
        for (int i = 0; i < count; ++i) arrive(last + kPeriod);
    }
    void arrive(nanoseconds arrival, nanoseconds waited = 0ms) {
        last = arrival;
        late += expectation.arrived(arrival, kPeriod, waited);
        expectation.launched(arrival, arrival);
    }
    bool lends(nanoseconds now, nanoseconds held_deadline = 100s) {
        const auto awaited = expectation.awaited(kPeriod, kDeadline, 0ms);
        return awaited && !awaited->rests && sched::is_lent(*awaited, held_deadline, now);
    }
};

}  // namespace

TEST_CASE("A chain is absent from a margin after its frame should have launched, for a period",
          "[sched][absence]") {
    Frames f(3);
    CHECK_FALSE(f.lends(f.last + 20ms));
    CHECK_FALSE(f.lends(f.last + 21ms - 1ns));
    CHECK(f.lends(f.last + 21ms));
    CHECK(f.lends(f.last + 41ms - 1ns));
    CHECK_FALSE(f.lends(f.last + 41ms));  // it has stopped
    CHECK_FALSE(f.lends(f.last + 10s));
}

TEST_CASE("A frame that is told of out of order moves no other", "[sched][absence]") {
    Expectation expectation;
    for (const nanoseconds arrival : {0ms, 33ms, 99ms, 66ms}) {
        expectation.arrived(kStart + arrival, 33ms);
        expectation.launched(kStart + arrival, kStart + arrival);
    }
    expectation.arrived(kStart + 131'900us, 33ms);
    expectation.launched(kStart + 131'900us, kStart + 131'900us);
    CHECK(expectation.jitter() < 1ms);
    const auto awaited = expectation.awaited(33ms, 33ms, 0ms);
    REQUIRE(awaited);
    CHECK(awaited->since >= kStart + 131'900us + 33ms + sched::kAbsenceMargin);
}

TEST_CASE("Nothing is lent for a chain that nobody has seen yet", "[sched][absence]") {
    Frames f(0);
    CHECK_FALSE(f.lends(kStart));
}

TEST_CASE("Only who is less urgent than the expected frame is lent urgency", "[sched][absence]") {
    Frames f(3);
    const nanoseconds deadline = f.last + kPeriod + kDeadline;
    CHECK_FALSE(f.lends(f.last + 25ms, deadline));
    CHECK(f.lends(f.last + 25ms, deadline + 1ns));
}

TEST_CASE("A loan lasts for 100 ms at most", "[sched][absence]") {
    Expectation slow;
    slow.arrived(kStart, 1s);
    slow.launched(kStart, kStart);
    const auto awaited = slow.awaited(1s, 1s, 0ms);
    REQUIRE(awaited);
    CHECK(awaited->since == kStart + 1s + 15'625us);  // a sixty-fourth of its period
    CHECK(awaited->until - awaited->since == 100ms);
}

TEST_CASE("A frame that has arrived is awaited until its first launch", "[sched][absence]") {
    Frames f(3);
    const nanoseconds arrival = f.last + 20ms;
    f.expectation.arrived(arrival, kPeriod);
    const auto awaited = f.expectation.awaited(kPeriod, kDeadline, 3ms);
    REQUIRE(awaited);
    CHECK(awaited->since == arrival + 3ms + 1ms);
    CHECK(awaited->deadline == arrival + 15ms);
    f.expectation.launched(arrival, arrival);
    CHECK(f.expectation.awaited(kPeriod, kDeadline, 3ms)->since == arrival + 24ms);
}

TEST_CASE("The jitter seen is waited for", "[sched][absence]") {
    Frames f(3);
    f.arrive(f.last + 26ms);
    CHECK(f.late == 1);
    // Due 20 ms after it should have come, and a quarter of its delay.
    CHECK_FALSE(f.lends(f.last + 22500us - 1ns));
    CHECK(f.lends(f.last + 22500us));
    f.arrive(f.last + 20ms);
    CHECK(f.late == 1);  // as it does lately
    for (int i = 0; i < 300; ++i) f.arrive(f.last + 20ms);
    CHECK(f.expectation.jitter() < 100us);  // forgotten
}

TEST_CASE("A delay that a loan ends is no jitter, and still a late start", "[sched][absence]") {
    Frames f(3);
    f.expectation.lend(f.last + 25ms);
    f.arrive(f.last + 28ms);
    CHECK(f.expectation.jitter() == 0ms);
    CHECK(f.late == 1);
    f.expectation.lend(f.last + 19ms - 1ns);
    f.arrive(f.last + 22ms);  // it did not help
    CHECK(f.expectation.jitter() == 8ms);
}

TEST_CASE("A frame is due a period after when the last one was, however late that came",
          "[sched][absence]") {
    Frames f(3);
    const nanoseconds first = f.last;
    f.expectation.lend(first + 28ms);
    f.arrive(first + 28ms);
    CHECK_FALSE(f.lends(first + 43ms - 1ns));
    CHECK(f.lends(first + 43ms));  // 40, a quarter of 8, and the margin
    f.arrive(first + 40ms);        // early: what the others are counted from
    CHECK(f.lends(first + 61ms));
}

TEST_CASE("A delay while launches wait is no jitter, unless they always do", "[sched][absence]") {
    Frames f(8);
    for (int i = 0; i < 4; ++i) {
        f.arrive(f.last + 26ms, f.last + 24ms);
        f.arrive(f.last + 14ms);
    }
    CHECK(f.expectation.jitter() == 0ms);
    CHECK(f.late == 4);
    for (int i = 0; i < 17; ++i) f.arrive(f.last + 21ms, f.last + 20ms);
    CHECK(f.expectation.jitter() > 1ms);
}

TEST_CASE("A frame that was left out is late, and no jitter", "[sched][absence]") {
    Frames f(3);
    f.arrive(f.last + 60ms);
    CHECK(f.late == 1);
    CHECK(f.expectation.jitter() == 0ms);
}

TEST_CASE("Loans in vain become rare, until one helps", "[sched][absence]") {
    Frames f(3);
    int loans = 0;
    for (int i = 0; i < 200; ++i) {  // a chain that comes at half of the rate that its config says
        if (f.lends(f.last + 30ms)) {
            f.expectation.lend(f.last + 30ms);
            ++loans;
        }
        f.arrive(f.last + 60ms);
    }
    CHECK(loans >= 3);
    CHECK(loans <= 9);
    for (int i = 0; i < 70; ++i) f.arrive(f.last + 20ms);
    REQUIRE(f.lends(f.last + 30ms));
    f.expectation.lend(f.last + 30ms);
    f.arrive(f.last + 31ms);
    CHECK(f.lends(f.last + 25ms));
}

TEST_CASE("Loans to frames that have arrived become rare as well", "[sched][absence]") {
    Frames f(3);
    const auto frame = [&](nanoseconds launches_after) {
        const nanoseconds arrival = f.last + 20ms;
        f.last = arrival;
        f.expectation.arrived(arrival, kPeriod);
        const bool lent = f.lends(arrival + 5ms);
        if (lent) f.expectation.lend(arrival + 5ms);
        f.expectation.launched(arrival, arrival + launches_after);
        return lent;
    };
    int loans = 0;
    for (int i = 0; i < 200; ++i) loans += frame(10ms);  // of work on the CPU that nobody knows of
    CHECK(loans >= 3);
    CHECK(loans <= 9);
    while (!frame(6ms)) {  // the loan helps
    }
    CHECK(frame(6ms));
    CHECK(frame(6ms));
}

TEST_CASE("Nothing is awaited before the chain's last frame has ended", "[sched][absence]") {
    Frames frames(3);
    const nanoseconds due = frames.last + kPeriod;
    frames.expectation.ended(due + 5ms);  // late, so its thread could not come
    CHECK_FALSE(frames.lends(due + 5ms));
    CHECK_FALSE(frames.lends(due + 5900us));
    CHECK(frames.lends(due + 6ms));
    CHECK(frames.lends(due + 25ms));
    CHECK_FALSE(frames.lends(due + 26ms));
}

TEST_CASE("Jitter follows the largest delay, by shares if asked for", "[sched][absence]") {
    Jitter jitter;
    jitter.saw(8ms, 8);
    CHECK(jitter.seen() == 1ms);
    jitter.saw(8ms, 1);
    CHECK(jitter.seen() == 8ms);
    jitter.saw(-5ms, 1);
    CHECK(jitter.seen() == 7875us);
}

namespace {

// An instance with a deadline in 100 ms, read 10 ms after its start.
struct Instance {
    std::unique_ptr<abi::TaskSlot> slot = std::make_unique<abi::TaskSlot>();
    nanoseconds now = kStart + 10ms;
    Instance() {
        slot->state = abi::TaskState::kGpu;
        slot->deadline_ns = nanoseconds(kStart + 100ms).count();
        slot->period_ns = nanoseconds(kPeriod).count();
        slot->look_ns = slot->launch_ns = slot->progress_ns = nanoseconds(now - 2ms).count();
    }
    std::optional<sched::Awaited> stalled(nanoseconds jitter = 0ms) {
        return sched::stalled(*slot, model::read_slot(*slot, nullptr, 0, now), jitter);
    }
};

}  // namespace

TEST_CASE("An instance has stalled when its GPU work is done and its thread launches nothing",
          "[sched][absence]") {
    Instance i;
    REQUIRE(i.stalled());
    CHECK(i.stalled()->since == i.now - 1700us);
    CHECK(i.stalled()->until == i.now + 18300us);
    CHECK(i.stalled()->deadline == kStart + 100ms);
    i.slot->launched_ns = nanoseconds(1ms).count();  // unmarked
    CHECK_FALSE(i.stalled());
    i.now += 301us;  // longer than twice that and a stall
    CHECK(i.stalled());
    i.slot->marks_issued = 1;  // somebody can see that it is not done
    i.slot->launched_at_mark_ns[1] = nanoseconds(1ms).count();
    CHECK_FALSE(i.stalled());
}

TEST_CASE("Whose launching others slow has not stalled so soon", "[sched][absence][launching]") {
    Instance i;
    i.slot->launching = model::Launching::kSlowed;
    CHECK(i.stalled()->since == i.now + 1ms);
}

TEST_CASE("A task launches until it has launched all, or pauses", "[model][launching]") {
    Instance i;
    const auto launches = [&] {
        return model::read_slot(*i.slot, nullptr, 0, i.now).launching.is_next;
    };
    const auto is_launching = [&] { return model::is_launching(*i.slot, i.now); };
    i.slot->head_remaining_ns = nanoseconds(1ms).count();
    CHECK_FALSE(launches());  // 2 ms ago
    CHECK_FALSE(is_launching());
    CHECK(model::read_slot(*i.slot, nullptr, 0, i.now).launching.pauses);
    i.slot->launch_ns = nanoseconds(i.now - 900us).count();
    CHECK(launches());
    CHECK(is_launching());
    i.slot->head_remaining_ns = 0;
    CHECK_FALSE(launches());
    CHECK_FALSE(is_launching());
    i.slot->head_remaining_ns = nanoseconds(1ms).count();
    i.slot->state = abi::TaskState::kHeld;
    i.slot->look_ns = nanoseconds(i.now - 100us).count();
    CHECK_FALSE(launches());  // held for the GPU, or paced
    i.slot->queue_why = abi::Why::kTurnToLaunch;
    CHECK(launches());
    CHECK_FALSE(is_launching());  // and keeps nobody from it
}

TEST_CASE("An instance has stalled when its CPU segment should have ended", "[sched][absence]") {
    Instance i;
    i.slot->state = abi::TaskState::kCpu;
    i.slot->cpu_until_ns = nanoseconds(kStart + 5ms).count();
    REQUIRE(i.stalled());
    CHECK(i.stalled(2ms)->since == kStart + 8ms);
}

TEST_CASE("Who is held, idle, or waits for all GPU work has not stalled", "[sched][absence]") {
    Instance i;
    for (const auto state : {abi::TaskState::kHeld, abi::TaskState::kIdle, abi::TaskState::kSync}) {
        i.slot->state = state;
        CHECK_FALSE(i.stalled());
    }
}

TEST_CASE("Who is lent urgency goes, behind all others", "[sched][admission]") {
    model::SlotView self;
    self.utilization = 0.5;
    const sched::Decision d = sched::behind_all(self);
    CHECK(d.admit);
    CHECK(d.rank == abi::kMaxTasks);
    CHECK(d.utilization == 0.5);
    CHECK_FALSE(d.is_free);
}

}  // namespace urgengo::testing
