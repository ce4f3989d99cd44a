// SPDX-License-Identifier: Apache-2.0
#include "host/model/unmarked_work.h"

#include "tests/support/catch.h"

using namespace std::chrono_literals;
using urgengo::model::nanoseconds;
using urgengo::model::UnmarkedWork;

namespace {

constexpr nanoseconds kStart = 100ms;

nanoseconds left(const UnmarkedWork& work, nanoseconds open, nanoseconds now,
                 nanoseconds progress = kStart) {
    return UnmarkedWork::left(open, work.until(), progress, now);
}

}  // namespace

TEST_CASE("UnmarkedWork falls with time from its launch on", "[model][unmarked_work]") {
    UnmarkedWork work;
    work.launched(kStart, 10ms, true);
    CHECK(left(work, 10ms, kStart) == 10ms);
    CHECK(left(work, 10ms, kStart + 4ms) == 6ms);
    work.launched(kStart + 4ms, 15ms, true);  // 5 ms more
    CHECK(left(work, 15ms, kStart + 4ms) == 11ms);
    CHECK(left(work, 15ms, kStart + 15ms) == 0ms);
    CHECK(left(work, 15ms, kStart + 1h) == 0ms);
    work.launched(kStart + 20ms, 2ms, true);  // there was a mark
    CHECK(left(work, 2ms, kStart + 21ms) == 1ms);
}

TEST_CASE("UnmarkedWork is done an estimate after a late launch", "[model][unmarked_work]") {
    UnmarkedWork work;
    work.launched(kStart, 1ms, true);
    work.launched(kStart + 20ms, 2ms, true);
    CHECK(left(work, 2ms, kStart + 20ms) == 1ms);
    CHECK(left(work, 2ms, kStart + 21ms) == 0ms);
}

TEST_CASE("UnmarkedWork takes twice the time behind others", "[model][unmarked_work]") {
    UnmarkedWork work;
    work.launched(kStart, 10ms, false);
    CHECK(left(work, 10ms, kStart + 10ms) == 10ms);
    CHECK(left(work, 10ms, kStart + 15ms) == 5ms);
}

TEST_CASE("UnmarkedWork has not begun before the last mark was seen", "[model][unmarked_work]") {
    UnmarkedWork work;
    work.launched(kStart, 10ms, true);
    CHECK(left(work, 10ms, kStart + 10ms, kStart + 7ms) == 7ms);
}
