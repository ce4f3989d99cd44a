// SPDX-License-Identifier: Apache-2.0
//
// What the guard has chosen for a chain, as its launches see it.
#include <thread>

#include "host/runtime/live_guard.h"
#include "tests/support/runtime_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using sched::GuardMode;

namespace {

/// The frames of `tight` take this part of their deadline.
struct Ratios {
    double enforced, with_priorities;
};

struct GuardFixture : RuntimeFixture {
    int sleeps = 0;

    GuardFixture() {
        clock.on_sleep = [this] { ++sleeps; };
    }
    GuardMode mode(const char* chain) { return rt().guard().mode(chain[0] == 't' ? 0 : 1); }
    /// Frames end, without a launch, until the guard has settled, or half a minute is over.
    void run_frames(Ratios ratios) {
        const std::chrono::nanoseconds end = clock.now() + 30s;
        while (clock.now() < end) {
            clock.advance(100ms);
            begin(thread_b, "loose", 10ms);
            rt().frames().task_end(thread_b);
            const double ratio = mode("tight") == GuardMode::kEnforce      ? ratios.enforced
                                 : mode("tight") == GuardMode::kPriorities ? ratios.with_priorities
                                                                           : 0.5;
            begin(thread_a, "tight");
            clock.advance(std::chrono::microseconds(static_cast<int>(ratio * 20'000)));
            rt().frames().task_end(thread_a);
        }
        sleeps = 0;
    }
    /// Both are on the GPU, which gets on with nothing; `loose` comes second.
    Grant launch_both() {
        begin(thread_a, "tight");
        for (int i = 0; i < 20; ++i) launch(thread_a, kStreamA);
        begin(thread_b, "loose");
        Grant grant;
        for (int i = 0; i < 20; ++i) grant = launch(thread_b, kStreamB);
        return grant;
    }
};

}  // namespace

TEST_CASE("Chains are held and paced when scheduling helps", "[runtime][guard]") {
    GuardFixture f;
    f.resolved.config.scheduler.packing.share_slack = std::chrono::hours(1);
    f.run_frames({0.5, 1.5});
    CHECK(f.rt().guard().summary() == "");
    CHECK(std::string(f.stats(0).guard.load()) == "enforce");
    CHECK(f.stats(0).guard_found.finding.pairs == 0);
    CHECK(f.launch_both().scheduled);
    CHECK(f.sleeps > 0);
}

TEST_CASE("Chains that scheduling makes late get priorities, and are neither held nor paced",
          "[runtime][guard]") {
    GuardFixture f;
    f.resolved.config.scheduler.packing.share_slack = std::chrono::hours(1);
    f.run_frames({1.5, 0.5});
    REQUIRE(std::string(f.stats(0).guard.load()) == "priorities");
    CHECK(f.rt().report().warnings().size() == 1);
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 20; ++i) f.launch(f.thread_a, kStreamA);
    CHECK(f.sleeps == 0);
    const Grant grant = f.launch(f.thread_a, kStreamA);
    CHECK(grant.scheduled);
    CHECK(grant.set_priority);
}

TEST_CASE("Launches of chains that priorities make late, too, are only counted",
          "[runtime][guard]") {
    GuardFixture f;
    f.run_frames({1.5, 1.5});
    REQUIRE(std::string(f.stats(0).guard.load()) == "observe");
    f.begin(f.thread_a, "tight");
    const Grant grant = f.launch(f.thread_a);
    CHECK(grant.task);
    CHECK_FALSE(grant.scheduled);
    CHECK_FALSE(grant.set_priority);
    CHECK(f.stats(0).frames.observed == 0);  // those have another reason
}

TEST_CASE("Nothing falls back when the guard is off, or there is nothing to fall back from",
          "[runtime][guard]") {
    GuardFixture f;
    SECTION("off") {
        f.resolved.config.scheduler.guard = false;
    }
    SECTION("nothing") {
        f.resolved.config.scheduler.admission = config::Admission::kNone;
        f.resolved.config.scheduler.binding = config::Binding::kNone;
    }
    f.run_frames({1.5, 0.5});
    CHECK(std::string(f.stats(0).guard.load()) == "off");
    CHECK(f.mode("tight") == GuardMode::kEnforce);
    CHECK(f.rt().report().warnings().empty());
}

TEST_CASE("Comparison ends when UrgenGo is switched off", "[runtime][guard]") {
    GuardFixture f;
    for (int i = 0; f.mode("tight") == GuardMode::kEnforce; ++i) {
        REQUIRE(i < 200);
        f.clock.advance(100ms);
        f.begin(f.thread_a, "tight");
        f.clock.advance(30ms);
        f.rt().frames().task_end(f.thread_a);
    }
    f.rt().steering().set_mode(config::Mode::kObserve);
    CHECK(f.mode("tight") == GuardMode::kEnforce);
}

TEST_CASE("Guard that is taken while UrgenGo is switched off pauses at the next frame",
          "[runtime][guard]") {
    GuardFixture f;
    runtime::LiveGuard guard(f.resolved.config);
    std::chrono::nanoseconds now{1s};
    for (int i = 0; guard.enforces(0); ++i, now += 100ms) {
        REQUIRE(i < 200);
        guard.frame_began(0, now - 30ms);
        guard.frame_ended(0, 30ms, {}, now);
    }
    {
        const auto lock = guard.take();
        std::thread([&] { guard.pause(); }).join();
        CHECK_FALSE(guard.enforces(0));
    }
    guard.frame_began(0, now);
    CHECK(guard.enforces(0));
}
