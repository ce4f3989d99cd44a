// SPDX-License-Identifier: Apache-2.0
//
// Stamps that programs take with the wrong clock.
#include "host/model/arrival_stamp.h"

#include <cstdint>
#include <limits>

#include "tests/support/catch.h"
#include "tests/support/runtime_fixture.h"

namespace urgengo::testing {
namespace {

using model::convert_stamp;
using model::is_plausible;
using std::chrono::nanoseconds;

constexpr std::int64_t kLeast = std::numeric_limits<std::int64_t>::min();
constexpr std::int64_t kMost = std::numeric_limits<std::int64_t>::max();

}  // namespace

TEST_CASE("A stamp is converted between clocks, and stays within what can be represented",
          "[model][arrivals]") {
    const nanoseconds wall = 1'800'000'000s, now = 5000s;
    CHECK(convert_stamp(nanoseconds(wall - 3ms).count(), wall, now) == now - 3ms);
    CHECK(convert_stamp(nanoseconds(10s).count(), wall, now) == now - (wall - 10s));
    CHECK(convert_stamp(kLeast, wall, now).count() == kLeast);
    CHECK(convert_stamp(kMost, wall, now) == now - wall + nanoseconds(kMost));
    CHECK(convert_stamp(kMost, nanoseconds(-5), now).count() == kMost);
    CHECK(convert_stamp(kLeast, nanoseconds(-5), now) < now);
}

TEST_CASE("A stamp is plausible up to a period ahead, and until its frame must have ended",
          "[model][arrivals]") {
    const nanoseconds now = 5000s, period = 100ms, abandoned_after = 800ms;
    const auto plausible = [&](nanoseconds stamp) {
        return is_plausible(stamp, now, period, abandoned_after);
    };
    CHECK(plausible(now));
    CHECK(plausible(now + 1100ms));
    CHECK_FALSE(plausible(now + 1101ms));
    CHECK(plausible(now - 1800ms));
    CHECK_FALSE(plausible(now - 1801ms));
    CHECK_FALSE(plausible(nanoseconds(kLeast)));
    CHECK_FALSE(plausible(nanoseconds(kMost)));
}

TEST_CASE("Runtime takes the time of the call for a frame whose stamp is implausible, and says so",
          "[runtime][arrivals]") {
    RuntimeFixture f;
    const nanoseconds wrong =
        GENERATE(nanoseconds(kLeast), nanoseconds(kMost), nanoseconds(-1h), nanoseconds(1h));
    const nanoseconds now = f.clock.now();
    const auto instance = f.rt().frames().arrival(nullptr, "tight", wrong);
    REQUIRE_FALSE(f.rt().frames().task_begin(f.thread_a, instance, "detect"));
    const Grant grant = f.launch(f.thread_a);
    REQUIRE(grant.task);
    CHECK(grant.task->tracked.arrival == now);
    CHECK(grant.task->slot->deadline_ns == nanoseconds(now + 20ms).count());
    CHECK(f.stats(0).frames.implausible == 1);
    const auto warnings = f.rt().report().warnings();
    REQUIRE(warnings.size() == 2);  // the other: nothing matched `loose`
    CHECK(warnings[1] ==
          "warning: 1 of 1 arrivals that hints told of chain 'tight' are implausible (another "
          "clock?): the time of the call was taken instead");
}

TEST_CASE("A fast chain's frames push out none of a slow one's", "[runtime][instances]") {
    RuntimeFixture f;
    const auto slow = f.rt().frames().arrival(nullptr, "loose", f.clock.now());
    for (int i = 0; i < 1000; ++i) {
        const auto fast = f.rt().frames().arrival(nullptr, "tight", f.clock.now());
        CHECK(fast != slow);
        f.rt().frames().task_begin(f.thread_b, fast, "detect");
        f.rt().frames().task_end(f.thread_b);
    }
    CHECK_FALSE(f.rt().frames().task_begin(f.thread_a, slow, "detect"));
    CHECK(f.launch(f.thread_a).task);
    f.rt().frames().task_end(f.thread_a);
    CHECK(f.stats(0).frames.finished == 1000);
    CHECK(f.stats(0).frames.missed == 0);
    CHECK(f.stats(1).frames.finished == 1);
    CHECK(f.stats(1).frames.missed == 0);
}

}  // namespace urgengo::testing
