// SPDX-License-Identifier: Apache-2.0
#include "host/sched/lateness_windows.h"

#include <vector>

#include "tests/support/catch.h"

using namespace std::chrono_literals;
using urgengo::sched::LatenessWindows;
using urgengo::sched::nanoseconds;

namespace {

/// Windows of 1 s in which frames had this lateness in all.
LatenessWindows of(const std::vector<double>& sums) {
    LatenessWindows windows;
    nanoseconds now = 0s;
    windows.next(now, 1s);
    for (const double sum : sums) {
        windows.add(sum / 2);
        windows.add(sum / 2);
        windows.next(now += 1s, 1s);
    }
    return windows;
}

}  // namespace

TEST_CASE("Windows are uneven where many frames are late in some and few in others",
          "[sched][guard]") {
    CHECK(of({20, 1, 0, 15, 2, 30, 0, 12}).are_uneven());
    CHECK_FALSE(of({10, 12, 9, 10, 13, 8, 11, 10}).are_uneven());
    CHECK_FALSE(of({0, 0, 0, 0, 0, 0, 0, 0}).are_uneven());
    // Another program from there on.
    CHECK_FALSE(of({40, 42, 39, 41, 10, 12, 9, 10, 13}).are_uneven());
    // Too few to say.
    CHECK_FALSE(of({20, 1, 30}).are_uneven());
}

TEST_CASE("Worst windows are the last ones', and in a row", "[sched][guard]") {
    CHECK(of({1, 5, 2}).worst(1) == 5);
    CHECK(of({1, 5, 2}).worst(2) == 7);
    std::vector<double> sums(30, 1);
    sums[0] = 100;
    CHECK(of(sums).worst(2) == 2);
    // The oldest and the newest are no neighbours.
    sums = std::vector<double>(16, 1);
    sums.front() = sums.back() = 10;
    CHECK(of(sums).worst(2) == 11);
    CHECK(LatenessWindows{}.worst(4) == 0);
}

TEST_CASE("A window is over after its length", "[sched][guard]") {
    LatenessWindows windows;
    CHECK(windows.is_over(0s));
    windows.next(10s, 2s);
    CHECK_FALSE(windows.is_over(11s));
    CHECK(windows.is_over(12s));
}

TEST_CASE("What was skipped is in no window", "[sched][guard]") {
    LatenessWindows windows;
    windows.next(10s, 2s);
    windows.add(5);
    windows.skip(11s);
    CHECK_FALSE(windows.is_over(12s));
    windows.add(1);
    windows.next(13s, 2s);
    CHECK(windows.worst(1) == 1);
}
