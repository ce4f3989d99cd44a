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
    work.launched(kStart, 10ms, 0ns, true, 7);
    CHECK(left(work, 10ms, kStart) == 10ms);
    CHECK(left(work, 10ms, kStart + 4ms) == 6ms);
    work.launched(kStart + 4ms, 15ms, 0ns, true, 7);  // 5 ms more
    CHECK(left(work, 15ms, kStart + 4ms) == 11ms);
    CHECK(left(work, 15ms, kStart + 15ms) == 0ms);
    CHECK(left(work, 15ms, kStart + 1h) == 0ms);
    work.launched(kStart + 20ms, 2ms, 0ns, true, 8);  // there was a mark
    CHECK(left(work, 2ms, kStart + 21ms) == 1ms);
    work.launched(kStart + 30ms, 1ms, 0ns, true, 8);  // all of it was found executed
    CHECK(left(work, 1ms, kStart + 30ms) == 1ms);
    CHECK(left(work, 1ms, kStart + 31ms) == 0ms);
}

TEST_CASE("UnmarkedWork has no more left than marks of branches say", "[model][unmarked_work]") {
    UnmarkedWork work;
    work.launched(kStart, 10ms, 0ns, false, 7);
    work.launched(kStart + 1ms, 11ms, 9ms, false, 7);
    CHECK(left(work, 11ms, kStart + 1ms, kStart - 20ms) == 4ms);  // twice as long, behind others
}

TEST_CASE("UnmarkedWork is done an estimate after a late launch", "[model][unmarked_work]") {
    UnmarkedWork work;
    work.launched(kStart, 1ms, 0ns, true, 7);
    work.launched(kStart + 20ms, 2ms, 0ns, true, 7);
    CHECK(left(work, 2ms, kStart + 20ms) == 1ms);
    CHECK(left(work, 2ms, kStart + 21ms) == 0ms);
}

TEST_CASE("UnmarkedWork takes twice the time behind others", "[model][unmarked_work]") {
    UnmarkedWork work;
    work.launched(kStart, 10ms, 0ns, false, 7);
    CHECK(left(work, 10ms, kStart + 10ms) == 10ms);
    CHECK(left(work, 10ms, kStart + 15ms) == 5ms);
}

TEST_CASE("UnmarkedWork has not begun before the last mark was seen", "[model][unmarked_work]") {
    UnmarkedWork work;
    work.launched(kStart, 10ms, 0ns, true, 7);
    CHECK(left(work, 10ms, kStart + 10ms, kStart + 7ms) == 7ms);
}

TEST_CASE("UnmarkedWork tells in a word until when, and which mark it is behind",
          "[model][unmarked_work]") {
    UnmarkedWork work;
    CHECK(work.word() == 0);
    CHECK_FALSE(UnmarkedWork::may_be_under_way(0, 0));
    CHECK_FALSE(work.is_last(0));
    work.launched(kStart, 10ms, 0ns, true, 0x1234);
    CHECK(work.is_last(0x1234));
    CHECK_FALSE(work.is_last(0x1235));
    CHECK(UnmarkedWork::may_be_under_way(work.word(), 0x1234));
    CHECK_FALSE(UnmarkedWork::may_be_under_way(work.word(), 0x1233));
    CHECK_FALSE(UnmarkedWork::may_be_under_way(work.word(), 0x1235));
    CHECK_FALSE(work.is_over(0x1230));  // it is yet to begin
    CHECK_FALSE(work.is_over(0x1234));
    CHECK(work.is_over(0x1235));
    CHECK(UnmarkedWork::until(work.word()) <= work.until());
    CHECK(UnmarkedWork::until(work.word()) > work.until() - 256ns);
}
