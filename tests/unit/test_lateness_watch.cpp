// SPDX-License-Identifier: Apache-2.0
#include "host/sched/lateness_watch.h"

#include "tests/support/catch.h"

using namespace std::chrono_literals;
using urgengo::sched::LatenessWatch;
using urgengo::sched::nanoseconds;

namespace {

constexpr double kInTime = 0.5, kLate = 1.2;  // lateness 0.01, and a little over 1

/// Chain 0 alone, a frame each 100 ms, from the time on that comes with it.
struct OneChain {
    LatenessWatch watch{{100ms}};
    nanoseconds now{0};

    void frames(int number, double ratio) {
        for (int i = 0; i < number; ++i) watch.frame_ended(0, ratio, now += 100ms);
    }
    bool pays() const { return watch.pays_for_comparison(now); }
};

}  // namespace

TEST_CASE("Late frames pay for a comparison once there are enough of them", "[sched][guard]") {
    OneChain one;
    CHECK_FALSE(one.pays());
    CHECK(one.watch.running(5s) == 0s);
    one.frames(60, kInTime);
    CHECK_FALSE(one.pays());
    CHECK(one.watch.running(one.now) == 5900ms);
    one.frames(2, kLate);  // 0.2 s earned, of 0.5
    CHECK_FALSE(one.pays());
    one.frames(4, kLate);
    CHECK(one.pays());
    one.watch.spend();
    CHECK_FALSE(one.pays());
}

TEST_CASE("A comparison costs less where lateness is great just now", "[sched][guard]") {
    OneChain one;
    one.frames(60, kInTime);
    one.frames(3, kLate);
    one.watch.is_at(0, 0.1);
    CHECK_FALSE(one.pays());
    one.watch.is_at(0, 0.4);
    CHECK(one.pays());
}

TEST_CASE("A comparison costs a quarter where estimates contradict what is measured",
          "[sched][guard]") {
    OneChain one;
    one.frames(60, kInTime);
    one.frames(2, kLate);
    CHECK_FALSE(one.pays());
    one.watch.contradicts(0, true);
    CHECK(one.pays());
    one.watch.contradicts(0, false);
    CHECK_FALSE(one.pays());
}

TEST_CASE("Frames that are late while the program starts pay for nothing", "[sched][guard]") {
    OneChain one;
    one.frames(10, kLate);
    CHECK(one.watch.is_starting_up(one.now));
    CHECK_FALSE(one.pays());
    one.frames(1, kLate);
    CHECK_FALSE(one.watch.is_starting_up(one.now));
    one.frames(5, kLate);
    CHECK(one.pays());
}

TEST_CASE("Frames that were late ten seconds ago pay for nothing", "[sched][guard]") {
    OneChain one;
    one.frames(60, kInTime);
    one.frames(10, kLate);
    CHECK(one.pays());
    one.frames(100, kInTime);
    CHECK(one.pays());
    one.frames(1, kInTime);
    CHECK_FALSE(one.pays());
}

TEST_CASE("A single chain's lateness pays a third where the others are in time", "[sched][guard]") {
    LatenessWatch watch({100ms, 100ms, 100ms, 100ms, 100ms, 100ms});
    nanoseconds now{0};
    const auto frames = [&](int number, double of_first) {
        for (int i = 0; i < number; ++i) {
            now += 100ms;
            watch.frame_ended(0, of_first, now);
            for (std::size_t chain = 1; chain < 6; ++chain) watch.frame_ended(chain, kInTime, now);
        }
    };
    frames(60, kInTime);
    frames(13, kLate);  // 1.3 s: less than three times 0.5
    CHECK_FALSE(watch.pays_for_comparison(now));
    frames(4, kLate);
    CHECK(watch.pays_for_comparison(now));
    CHECK(watch.level() < 0.3);
}

TEST_CASE("A window is four periods of most chains, half a second to two", "[sched][guard]") {
    nanoseconds now = 1s;
    const auto window = [&](const std::vector<nanoseconds>& periods) {
        LatenessWatch watch(periods);
        for (std::size_t i = 0; i < periods.size(); ++i) watch.frame_ended(i, kInTime, now);
        return watch.window();
    };
    CHECK(window({200ms}) == 800ms);
    CHECK(window({10ms, 200ms, 900ms}) == 800ms);
    CHECK(window({10ms}) == 500ms);
    CHECK(window({5s}) == 2s);
    CHECK(LatenessWatch({200ms}).window() == 500ms);  // it has had no frame
}
