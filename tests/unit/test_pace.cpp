// SPDX-License-Identifier: Apache-2.0
#include "host/model/pace.h"

#include <memory>

#include "tests/support/catch.h"

using namespace std::chrono_literals;
using urgengo::model::kLaunchLatency;
using urgengo::model::LaunchLog;
using urgengo::model::nanoseconds;
using urgengo::model::Pace;

namespace {

/// A task with a mark behind every 200 us of estimated work; its kernels take 50.
struct Marked {
    std::unique_ptr<LaunchLog> log = std::make_unique<LaunchLog>();
    Pace pace;
    std::uint32_t sequence = 0;

    /// @param launched  when all four kernels are
    void span(nanoseconds launched) {
        for (int i = 0; i < 4; ++i) log->launched(50us, {.time = launched});
        log->marked(launched, ++sequence);
    }
    void saw(nanoseconds time, bool shared = true) { pace.saw(*log, {sequence, time}, shared); }
};

}  // namespace

TEST_CASE("Pace is 1 until two marks were seen", "[model][pace]") {
    Marked m;
    CHECK(m.pace.value(true) == 1);
    m.span(0us);
    m.saw(900us);
    CHECK(m.pace.value(true) == 1);
}

TEST_CASE("Pace is the time between marks for the work between them", "[model][pace]") {
    Marked m;
    m.span(0us);
    m.saw(200us);
    m.span(100us);
    m.saw(600us);  // twice as long as estimated
    CHECK(m.pace.value(true) == Approx(1 + 2. / 3));
    CHECK(m.pace.expected(true) == Approx(1 + 1. / 3));
    SECTION("of the last spans") {
        for (int i = 1; i < 20; ++i) {
            m.span(200us);
            m.saw(600us + i * 400us);
        }
        CHECK(m.pace.value(true) == Approx(2));
    }
    SECTION("over several, where some marks were not seen") {
        m.span(200us);
        m.span(200us);
        m.saw(1'400us);
        CHECK(m.pace.value(true) == Approx(1 + 2. / 3 + 0.8 / 3));
    }
    SECTION("which is another one for a task alone") {
        CHECK(m.pace.value(false) == 1);
        m.span(200us);
        m.saw(800us, false);
        CHECK(m.pace.value(false) == 1);
        CHECK(m.pace.value(true) == Approx(1 + 2. / 3));
    }
    SECTION("seen again, it says nothing new, nor does one that came before") {
        m.saw(5'000us);
        m.sequence -= 1;
        m.saw(6'000us);
        CHECK(m.pace.value(true) == Approx(1 + 2. / 3));
    }
}

TEST_CASE("Pace does not count time in which nothing was launched", "[model][pace]") {
    Marked m;
    m.span(0us);
    m.saw(200us);
    m.span(5'000us);
    m.saw(5'200us + kLaunchLatency);
    CHECK(m.pace.value(true) == Approx(1));
}

TEST_CASE("Pace stays within what can be believed", "[model][pace]") {
    Marked m;
    m.span(0us);
    m.saw(200us);
    m.span(100us);
    m.saw(1s);
    CHECK(m.pace.value(true) == Approx(1 + 7 * 2. / 3));
}

TEST_CASE("Pace learns nothing from what is not known any more", "[model][pace]") {
    Marked m;
    m.span(0us);
    m.saw(200us);
    for (int i = 0; i < 300; ++i) m.span(200us);
    m.saw(900us);
    CHECK(m.pace.value(true) == 1);
}
