// SPDX-License-Identifier: Apache-2.0
#include "host/sched/standing_aside.h"

#include "tests/support/catch.h"
#include "tests/support/governor_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using sched::StandingAside;

namespace {

/// Four chains of 10 ms, each of which launches for 6 ms what the GPU needs 1.5 ms for, slowed down
/// by the others: 2.4 launch at a time.
struct StandingAsideTest {
    explicit StandingAsideTest(const config::Scheduler& scheduler = {})
        : f({10ms, 10ms, 10ms, 10ms}, scheduler) {
        for (int i = 0; i < 4; ++i) {
            needs(i, 1500us, 4500us);
            f.task(i).is_crowded = true;
        }
    }
    void needs(int task, nanoseconds gpu, nanoseconds idle) {
        f.task(task).estimated.gpu_ns = gpu.count();
        f.task(task).estimated.idle_ns = idle.count();
        f.slot(task).mean_utilization_ppm = 1'000'000;
    }
    /// Frames of all chains begin. @returns whether those that did last stand aside
    bool run(nanoseconds time) {
        bool stands_aside = false;
        ever = false;
        for (const nanoseconds end = f.now + time; f.now < end; f.now += 5ms) {
            if (is_beside_bystander) f.governor.bystanders().launched();
            for (int i = 0; i < num_at_work; ++i) {
                f.task(i).chain->last_arrival_ns = f.now.count();
                ever |= stands_aside = f.governor.stands_aside(f.now);
            }
        }
        return stands_aside;
    }

    bool never(nanoseconds time) {
        run(time);
        return !ever;
    }

    GovernorFixture f;
    int num_at_work = 4;
    bool is_beside_bystander = false;
    bool ever = false;  ///< some frame of the last run stood aside
};

constexpr nanoseconds kLooks = StandingAside::kLooks * StandingAside::kEvery;

}  // namespace

TEST_CASE("Where launching is crowded, frames are left alone, and looked at now and then",
          "[sched][aside]") {
    StandingAsideTest t;
    CHECK_FALSE(t.run(kLooks - 20ms));
    CHECK(t.run(30ms));
    CHECK(t.run(StandingAside::kAside - 150ms));
    CHECK_FALSE(t.run(250ms));
    CHECK(t.run(kLooks));
    SECTION("until it is not crowded any more") {
        t.f.task(0).is_crowded = false;
        CHECK_FALSE(t.run(StandingAside::kEvery + 10ms));
        CHECK(t.never(10s));
    }
    SECTION("until a bystander keeps the GPU busy") {
        t.is_beside_bystander = true;
        CHECK_FALSE(t.run(StandingAside::kEvery + 100ms));
        CHECK(t.never(10s));
    }
    SECTION("until chains have stopped") {
        t.num_at_work = 3;
        CHECK_FALSE(t.run(StandingAside::kEvery + 30ms));
        CHECK(t.never(10s));
    }
}

TEST_CASE("Frames are scheduled where that may help", "[sched][aside]") {
    StandingAsideTest t;
    SECTION("fewer launch at a time") {
        t.needs(3, 200us, 500us);
        CHECK(t.never(10s));
    }
    SECTION("what it is that slows them down is not each other's launching") {
        for (int i : {0, 1}) t.f.task(i).is_crowded = false;
        CHECK(t.never(10s));
    }
    SECTION("they take turns") {
        t.f.slot(2).launching = model::Launching::kSlowed;
        CHECK(t.never(10s));
    }
    SECTION("the GPU has little room") {
        for (int i = 0; i < 4; ++i) t.needs(i, 2500us, 4500us);
        CHECK(t.never(10s));
    }
    SECTION("half of the GPU is a GPU-bound task's") {
        for (int i = 0; i < 4; ++i) t.needs(i, 1ms, 7ms);
        t.needs(3, 5100us, 0us);
        CHECK(t.never(10s));
        t.needs(3, 4900us, 0us);
        CHECK(t.run(kLooks + 20ms));
    }
    SECTION("a bystander keeps the GPU busy") {
        t.f.bystander_gets_busy();
        t.is_beside_bystander = true;
        CHECK(t.never(10s));
    }
}

TEST_CASE("One chain that is behind makes no crowd", "[sched][aside]") {
    StandingAsideTest t;
    for (int i = 1; i < 4; ++i) t.f.task(i).is_crowded = false;
    t.needs(0, 1ms, 25ms);
    CHECK(t.never(1s));
}

TEST_CASE("Nothing is let alone where UrgenGo only decides, or only observes", "[sched][aside]") {
    StandingAsideTest t;
    REQUIRE(t.run(kLooks + 20ms));
    t.f.governor.steered().set(GENERATE(config::Mode::kShadow, config::Mode::kObserve));
    CHECK(t.never(1s));
}

TEST_CASE("A config that asks for another way to schedule gets it", "[sched][aside]") {
    config::Scheduler scheduler;
    SECTION("another policy") {
        scheduler.policy = config::Policy::kEdf;
    }
    SECTION("another admission") {
        scheduler.admission = config::Admission::kExclusive;
    }
    SECTION("another progress tracking") {
        scheduler.progress.tracking = config::Tracking::kSync;
    }
    SECTION("gates") {
        scheduler.dispatch.where = config::Dispatch::kHost;
    }
    StandingAsideTest t(scheduler);
    CHECK(t.never(10s));
}
