// SPDX-License-Identifier: Apache-2.0
#include "host/sched/lent_forks.h"

#include "tests/support/catch.h"

using namespace std::chrono_literals;

TEST_CASE("LentForks are free after loans in three of four instances", "[sched][fork_progress]") {
    urgengo::sched::LentForks lent;
    lent.lent(10, 1s);
    lent.lent(10, 2s);
    lent.lent(11, 3s);
    CHECK_FALSE(lent.are_free(3s));
    SECTION("the next but one, too") {
        lent.lent(13, 4s);
        CHECK(lent.are_free(5s));
        CHECK_FALSE(lent.are_free(15s));
    }
    SECTION("not for long") {
        lent.lent(14, 4s);
        CHECK_FALSE(lent.are_free(5s));
        lent.lent(1000, 6s);
        CHECK_FALSE(lent.are_free(6s));
    }
}
