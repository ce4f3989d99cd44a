// SPDX-License-Identifier: Apache-2.0
#include "host/sched/core_load.h"

#include <catch2/catch.hpp>

using std::chrono::nanoseconds;
using urgengo::sched::CoreLoad;

namespace {

constexpr nanoseconds kAsked{50'000};

/// Sleeps of 50 us, one of `every` of which takes `late` longer, for `time`.
struct Sleeper {
    CoreLoad cores;
    nanoseconds now{1'000'000'000};
    void sleeps(nanoseconds late, int every, nanoseconds time) {
        const nanoseconds end = now + time;
        for (int i = 1; now < end; ++i) {
            const nanoseconds took =
                kAsked + nanoseconds(15'000) + (i % every == 0 ? late : nanoseconds(0));
            now += took;
            cores.slept(kAsked, took, now);
        }
    }
};

}  // namespace

TEST_CASE("Cores are busy while sleeps end milliseconds late", "[sched][core_load]") {
    Sleeper s;
    s.sleeps(nanoseconds(0), 1, nanoseconds(2'000'000'000));
    CHECK_FALSE(s.cores.are_busy());
    s.sleeps(nanoseconds(4'000'000), 10, nanoseconds(600'000'000));
    CHECK(s.cores.are_busy());
    s.sleeps(nanoseconds(0), 1, nanoseconds(600'000'000));
    CHECK_FALSE(s.cores.are_busy());
    CHECK(s.cores.counts().windows >= 10);
    CHECK(s.cores.counts().busy >= 2);
    CHECK(s.cores.counts().busy <= 4);
}

TEST_CASE("Cores that are busy stay so while some sleeps are late", "[sched][core_load]") {
    constexpr nanoseconds kLate{4'000'000};
    constexpr int kQuarter = 170;  // of the time, about
    Sleeper s;
    s.sleeps(kLate, kQuarter, nanoseconds(2'000'000'000));
    CHECK_FALSE(s.cores.are_busy());
    s.sleeps(kLate, 10, nanoseconds(600'000'000));
    s.sleeps(kLate, kQuarter, nanoseconds(2'000'000'000));
    CHECK(s.cores.are_busy());
}

TEST_CASE("A few sleeps, and sleeps that are late by little, say nothing", "[sched][core_load]") {
    Sleeper s;
    for (int i = 0; i < 10; ++i) s.sleeps(nanoseconds(400'000'000), 1, nanoseconds(1));
    CHECK_FALSE(s.cores.are_busy());
    s.sleeps(nanoseconds(150'000), 1, nanoseconds(1'000'000'000));
    CHECK_FALSE(s.cores.are_busy());
}
