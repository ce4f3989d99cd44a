// SPDX-License-Identifier: Apache-2.0
#include "host/sched/bystanders.h"

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using sched::Bystanders;

namespace {

/// @returns after how many windows it was busy; -1: never
int busy_after(Bystanders& bystanders, int windows, auto&& launches) {
    for (int i = 0; i < windows; ++i) {
        bystanders.saw(launches(i));
        if (bystanders.are_busy()) return i + 1;
    }
    return -1;
}

}  // namespace

TEST_CASE("A bystander that launches all the time is busy after about 50 ms", "[sched]") {
    Bystanders bystanders;
    const int windows = busy_after(bystanders, 100, [](int) { return true; });
    CHECK(windows >= 5);
    CHECK(windows <= 12);
}

TEST_CASE("A bystander that launches now and then is not busy", "[sched]") {
    Bystanders bystanders;
    CHECK(busy_after(bystanders, 1000, [](int i) { return i % 6 == 0; }) == -1);
    CHECK(bystanders.are_there());
}

TEST_CASE("A bystander that slows nobody down does not count", "[sched]") {
    Bystanders bystanders;
    REQUIRE(busy_after(bystanders, 100, [](int) { return true; }) > 0);
    for (int i = 0; i < 2; ++i) bystanders.measured(1020us, 1ms, 10);
    bystanders.saw(true);
    CHECK(bystanders.are_busy());  // two instances may have met with nothing
    bystanders.measured(1020us, 1ms, 10);
    bystanders.saw(true);
    CHECK_FALSE(bystanders.are_busy());
    for (int i = 0; i < 20; ++i) bystanders.measured(1500us, 1ms, 10);
    CHECK(bystanders.saw(true));
    CHECK(bystanders.are_busy());
}

TEST_CASE("What was measured beside an earlier bystander says nothing of the next", "[sched]") {
    Bystanders bystanders;
    for (int i = 0; i < 20; ++i) bystanders.measured(1ms, 1ms, 10);  // before it came
    REQUIRE(busy_after(bystanders, 100, [](int) { return true; }) > 0);
    for (int i = 0; i < 20; ++i) bystanders.measured(1ms, 1ms, 10);
    bystanders.saw(true);
    REQUIRE_FALSE(bystanders.are_busy());
    SECTION("as it has gone") {
        for (int i = 0; i < 30; ++i) bystanders.saw(false);
    }
    SECTION("as it has gone while nobody looked") {
        bystanders.saw(false, 30);
    }
    CHECK(busy_after(bystanders, 100, [](int) { return true; }) > 0);
}

TEST_CASE("That a bystander slows nobody down is believed for five seconds", "[sched]") {
    Bystanders bystanders;
    REQUIRE(busy_after(bystanders, 100, [](int) { return true; }) > 0);
    for (int i = 0; i < 3; ++i) bystanders.measured(1ms, 1ms, 10);
    CHECK(busy_after(bystanders, 990, [](int) { return true; }) == -1);
    CHECK(busy_after(bystanders, 20, [](int) { return true; }) > 0);
}

TEST_CASE("Kernels longer than what a bystander puts between launches are held beside it",
          "[sched]") {
    Bystanders bystanders;
    REQUIRE(busy_after(bystanders, 100, [](int) { return true; }) > 0);
    CHECK(bystanders.are_busy(10ms));                                     // nobody knows
    for (int i = 0; i < 3; ++i) bystanders.measured(6500us, 2500us, 40);  // 100 us a launch
    CHECK(bystanders.are_busy(199us));
    CHECK_FALSE(bystanders.are_busy(201us));
    CHECK(bystanders.are_busy());
    for (int i = 0; i < 100; ++i) bystanders.saw(false);
    REQUIRE(busy_after(bystanders, 100, [](int) { return true; }) > 0);
    CHECK(bystanders.are_busy(10ms));  // another one
}

TEST_CASE("Who has no time to spare beside a bystander is held for very long kernels alone",
          "[sched]") {
    Bystanders bystanders;
    REQUIRE(busy_after(bystanders, 100, [](int) { return true; }) > 0);
    for (int i = 0; i < 3; ++i) bystanders.measured(6ms, 2ms, 40);  // 4 ms longer, 100 us a launch
    CHECK_FALSE(bystanders.are_busy(300us, 2ms, 8001us));
    CHECK(bystanders.are_busy(300us, 2ms, 7999us));
    CHECK(bystanders.are_busy(300us, 2ms, -1ms));
    CHECK_FALSE(bystanders.are_busy(500us, 2ms, -1ms));
    CHECK(bystanders.are_busy(10us, 2ms, 1s));  // not long
}

TEST_CASE("Kernels take longer beside a busy bystander, each by as much as it was seen to",
          "[sched]") {
    Bystanders bystanders;
    CHECK(bystanders.longer(40) == 0ns);
    REQUIRE(busy_after(bystanders, 100, [](int) { return true; }) > 0);
    CHECK(bystanders.longer(40) == 2ms);  // as others were
    for (int i = 0; i < 3; ++i) bystanders.measured(6ms, 2ms, 40);
    CHECK(bystanders.longer(10) == 1ms);
    for (int i = 0; i < 100; ++i) bystanders.saw(false);
    CHECK(bystanders.longer(10) == 0ns);
}

TEST_CASE("A bystander that has gone is forgotten", "[sched]") {
    Bystanders bystanders;
    REQUIRE(busy_after(bystanders, 100, [](int) { return true; }) > 0);
    int windows = 0;
    while (bystanders.are_busy() && windows < 100) ++windows, bystanders.saw(false);
    CHECK(windows < 25);  // 0.13 s
    for (int i = 0; i < 100; ++i) bystanders.saw(false);
    CHECK_FALSE(bystanders.are_there());
}

TEST_CASE("One of those who look ends a window, or all that have ended", "[sched]") {
    Bystanders bystanders;
    CHECK(bystanders.windows_ended(100ms) == 1);
    CHECK(bystanders.windows_ended(100ms) == 0);
    CHECK(bystanders.windows_ended(104ms) == 0);
    CHECK(bystanders.windows_ended(105ms) == 1);
    CHECK(bystanders.windows_ended(122ms) == 3);
}

TEST_CASE("Bystanders' windows are counted, by what was seen in them", "[sched]") {
    Bystanders bystanders;
    bystanders.saw(false, 7);
    const int windows = busy_after(bystanders, 100, [](int) { return true; });
    for (int i = 0; i < 3; ++i) bystanders.measured(1ms, 1ms, 10);
    bystanders.saw(true);
    const Bystanders::Counts counts = bystanders.counts();
    CHECK(counts.windows == 7 + static_cast<std::uint32_t>(windows) + 1);
    CHECK(counts.often == 2);
    CHECK(counts.busy == 1);
}
