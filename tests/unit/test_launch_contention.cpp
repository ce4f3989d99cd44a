// SPDX-License-Identifier: Apache-2.0
#include "host/model/launch_contention.h"

#include <algorithm>

#include "tests/support/catch.h"

using namespace std::chrono_literals;
using urgengo::model::LaunchContention;
using urgengo::model::Launching;
using urgengo::model::may_need_same_lock;
using urgengo::model::nanoseconds;

namespace {

constexpr nanoseconds kAlone{5'000'000};

constexpr int kFirst = LaunchContention::kTogetherFirst;

/// Instances that take `times` as long to launch as the profile says, beside so many others.
void run_among(LaunchContention& contention, double times, double others, int count,
               nanoseconds now = 1s) {
    const nanoseconds took(static_cast<std::int64_t>(times * kAlone.count()));
    for (int i = 0; i < count; ++i)
        contention.observe({.took = took,
                            .alone = kAlone,
                            .marks = 80,
                            .beside = others > 0 ? 60 : 0,
                            .others = static_cast<int>(80 * others)},
                           now);
}

/// The same where all need one lock.
void run(LaunchContention& contention, double times, bool beside, int count, nanoseconds now = 1s) {
    run_among(contention, times, beside ? std::max(times - 1, 0.1) : 0, count, now);
}

}  // namespace

TEST_CASE("Who takes twice as long beside others that launch is slowed", "[model][launching]") {
    LaunchContention contention;
    run(contention, 1, false, 4);
    run(contention, 2, true, kFirst - 1);
    CHECK(contention.verdict() == Launching::kUnknown);
    run(contention, 2, true, 1);
    CHECK(contention.verdict() == Launching::kSlowed);
    CHECK(contention.slowdown() == Approx(2));
    CHECK(contention.together() == Approx(1));
}

TEST_CASE("Who is slowed takes no turns where more at a time get more done", "[model][launching]") {
    LaunchContention contention;
    run_among(contention, 2, 2.5, 4 * kFirst);
    CHECK(contention.slowdown() == Approx(2));
    CHECK(contention.together() == Approx(1.75));
    CHECK(contention.verdict() == Launching::kParallel);
    run_among(contention, 3.5, 2.5, 4 * kFirst);
    CHECK(contention.verdict() == Launching::kSlowed);
    SECTION("a little more says nothing") {
        run_among(contention, 2.5, 2.5, 4 * kFirst);
        CHECK(contention.verdict() == Launching::kSlowed);
    }
    SECTION("much more ends it") {
        run_among(contention, 2, 2.5, 4 * kFirst);
        CHECK(contention.verdict() == Launching::kParallel);
    }
    SECTION("a few that a stall made longer do not begin it") {
        run_among(contention, 2, 2.5, 4 * kFirst);
        run_among(contention, 9, 2.5, kFirst);
        CHECK(contention.slowdown() == Approx(9));
        CHECK(contention.verdict() == Launching::kParallel);
    }
}

TEST_CASE("Who launches in parallel may need the same lock only from much less on",
          "[model][launching]") {
    LaunchContention contention;
    run_among(contention, 2, 2.5, 4 * kFirst);
    REQUIRE(contention.verdict() == Launching::kParallel);
    CHECK_FALSE(may_need_same_lock(contention.verdict()));
    run_among(contention, 2.5, 2.5, 4 * kFirst);
    CHECK(contention.together() == Approx(1.4));
    CHECK(contention.verdict() == Launching::kParallel);
    run_among(contention, 1.3, 0.6, 4 * kFirst);
    CHECK(contention.together() == Approx(1.23).margin(0.01));
    CHECK(contention.verdict() == Launching::kUnknown);
    CHECK(may_need_same_lock(contention.verdict()));
}

TEST_CASE("Who launches beside others as fast as alone is free", "[model][launching]") {
    LaunchContention contention;
    run(contention, 1.1, true, 4);
    CHECK(contention.verdict() == Launching::kFree);
}

TEST_CASE("A profile that is slower, or faster, than the program is no contention",
          "[model][launching]") {
    LaunchContention slower, faster;
    run(slower, 1.8, false, 4);
    run(slower, 1.9, true, 4);
    CHECK(slower.pace() == Approx(1.8));
    CHECK(slower.verdict() == Launching::kFree);
    run(faster, 0.6, false, 4);
    run(faster, 1.0, true, kFirst);
    CHECK(faster.verdict() == Launching::kSlowed);
}

TEST_CASE("A few slow instances are chance", "[model][launching]") {
    LaunchContention contention;
    run(contention, 1, true, kFirst);
    run(contention, 9, true, 3);
    CHECK(contention.verdict() == Launching::kFree);
    run(contention, 9, true, kFirst);
    CHECK(contention.verdict() == Launching::kSlowed);
}

TEST_CASE("Who is free stays so while it is hardly slower beside others", "[model][launching]") {
    LaunchContention contention;
    run_among(contention, 1.1, 2, kFirst);
    CHECK(contention.verdict() == Launching::kFree);
    run_among(contention, 1.25, 2, 4 * kFirst);
    CHECK(contention.together() == Approx(2.4));
    CHECK(contention.verdict() == Launching::kFree);
}

TEST_CASE("Who was taken for slowed by mistake is not so for longer and longer",
          "[model][launching]") {
    LaunchContention contention;
    nanoseconds now = 1s;
    for (int mistakes = 0; mistakes < 5; ++mistakes) {
        run_among(contention, 3, 2, 4 * kFirst, now);
        REQUIRE(contention.verdict() == Launching::kSlowed);
        run_among(contention, 1.5, 2, 4 * kFirst, now += 1s);
        REQUIRE(contention.verdict() == Launching::kParallel);
    }
    run_among(contention, 3, 2, 4 * kFirst, now);
    CHECK(contention.verdict() == Launching::kSlowed);
    run(contention, 1, false, 1, now + LaunchContention::kRetry);
    CHECK(contention.verdict() == Launching::kUnknown);
}

TEST_CASE("Beside few others, in between, or short: that tells nothing", "[model][launching]") {
    LaunchContention contention;
    for (int i = 0; i < 20; ++i) {
        contention.observe(
            {.took = 3 * kAlone, .alone = kAlone, .marks = 8, .beside = 3, .others = 6}, 1s);
        contention.observe({.took = 3 * kAlone, .alone = kAlone, .marks = 0, .beside = 0}, 1s);
        contention.observe({.took = 1ms, .alone = 100us, .marks = 2, .beside = 2}, 1s);
    }
    CHECK(contention.verdict() == Launching::kUnknown);
    CHECK(contention.slowdown() == 0);
    CHECK(contention.pace() == 3);  // only the first kind, of that: it is what is usual
    run(contention, 1.3, true, 2 * kFirst);
    CHECK(contention.verdict() == Launching::kUnknown);
}

TEST_CASE("Short instances, and those without marks, tell nothing of the pace",
          "[model][launching]") {
    LaunchContention contention;
    for (int i = 0; i < 20; ++i) {
        contention.observe({.took = 3 * kAlone, .alone = kAlone, .marks = 0, .beside = 0}, 1s);
        contention.observe({.took = 1ms, .alone = 100us, .marks = 2, .beside = 2}, 1s);
    }
    CHECK(contention.pace() == 1);
}

TEST_CASE("What it takes beside free ones is not its pace alone", "[model][launching]") {
    LaunchContention contention;
    run(contention, 1, false, 4);
    for (int i = 0; i < 20; ++i)
        contention.observe(
            {.took = 2 * kAlone, .alone = kAlone, .marks = 80, .beside = 0, .free = 240}, 1s);
    CHECK(contention.pace() == 2);
    CHECK(contention.is_contended());
}

TEST_CASE("What free ones get done meanwhile counts, too", "[model][launching]") {
    LaunchContention contention;
    run(contention, 1, false, 4);
    for (int i = 0; i < 4 * kFirst; ++i)
        contention.observe({.took = 2 * kAlone,
                            .alone = kAlone,
                            .marks = 80,
                            .beside = 60,
                            .others = 80,
                            .free = 160},
                           1s);
    CHECK(contention.slowdown() == Approx(2));
    CHECK(contention.together() == Approx(2));
    CHECK(contention.verdict() == Launching::kParallel);
}

TEST_CASE("Who launches in parallel is known after a while", "[model][launching]") {
    LaunchContention contention;
    run_among(contention, 2, 2.5, kFirst - 1);
    CHECK(contention.is_contended());
    CHECK_FALSE(contention.is_parallel());
    run_among(contention, 2, 2.5, 1);
    CHECK(contention.is_parallel());
    run_among(contention, 3.5, 2.5, 4 * kFirst);  // one lock
    CHECK_FALSE(contention.is_parallel());
    LaunchContention free;
    run(free, 1.1, true, 4);
    CHECK(free.is_parallel());
}

TEST_CASE("Beside work that no mark tells of it is not known to be alone", "[model][launching]") {
    LaunchContention contention;
    for (int i = 0; i < 20; ++i)
        contention.observe({.took = 2 * kAlone, .alone = kAlone, .marks = 80, .unknown = true}, 1s);
    CHECK(contention.is_contended());
}

TEST_CASE("Who is slowed down most of the time has that pace", "[model][launching]") {
    constexpr int kRecent = LaunchContention::kRecent;
    LaunchContention contention;
    run(contention, 0.9, false, kRecent);
    run_among(contention, 1, 3, kRecent);
    CHECK(contention.pace() == Approx(0.9));  // a little slower is chance
    CHECK_FALSE(contention.is_contended());
    run_among(contention, 1.2, 3, kRecent);
    CHECK(contention.pace() == Approx(1.2));
    CHECK_FALSE(contention.is_contended());
    run_among(contention, 1.8, 3, kRecent);
    CHECK(contention.pace() == Approx(1.8));
    CHECK(contention.is_contended());
    SECTION("and no more once it is not") {
        run(contention, 0.9, false, kRecent / 2);
        CHECK(contention.pace() == Approx(0.9));
        CHECK_FALSE(contention.is_contended());
    }
    SECTION("but not where turns are taken, which is for its pace alone") {
        run(contention, 3, true, 4 * kFirst);
        REQUIRE(contention.verdict() == Launching::kSlowed);
        CHECK(contention.pace() == Approx(0.9));
        CHECK_FALSE(contention.is_contended());
    }
}

TEST_CASE("Who is slowed is asked again, each time after twice as long", "[model][launching]") {
    LaunchContention contention;
    run(contention, 2, true, kFirst, 1s);
    run(contention, 1, false, 1, 20s);
    CHECK(contention.verdict() == Launching::kSlowed);
    run(contention, 1, false, 1, 21s);
    CHECK(contention.verdict() == Launching::kUnknown);
    run(contention, 2, true, kFirst, 22s);
    CHECK(contention.verdict() == Launching::kSlowed);
    run(contention, 1, false, 1, 61s);
    CHECK(contention.verdict() == Launching::kSlowed);
    run(contention, 1, false, 1, 62s);
    CHECK(contention.verdict() == Launching::kUnknown);
    // It has become free: from the start again.
    run(contention, 1, true, 4, 63s);
    CHECK(contention.verdict() == Launching::kFree);
}

TEST_CASE("Who keeps the others from launching while it is held is held no more",
          "[model][launching]") {
    LaunchContention contention;
    run(contention, 2, true, kFirst, 1s);
    for (const bool in_vain : {true, true, false, true, true}) contention.held(in_vain, 2s);
    CHECK(contention.verdict() == Launching::kSlowed);
    contention.held(true, 2s);
    CHECK(contention.verdict() == Launching::kFree);
    run(contention, 2, true, kFirst, 21s);
    CHECK(contention.verdict() == Launching::kFree);
    run(contention, 2, true, kFirst, 22s);
    CHECK(contention.verdict() == Launching::kSlowed);
    // And again, for twice as long.
    for (int i = 0; i < 3; ++i) contention.held(true, 23s);
    run(contention, 2, true, kFirst, 62s);
    CHECK(contention.verdict() == Launching::kFree);
    run(contention, 2, true, kFirst, 63s);
    CHECK(contention.verdict() == Launching::kSlowed);
}
