// SPDX-License-Identifier: Apache-2.0
#include "host/model/cpu_segments.h"

#include <array>

#include "tests/support/catch.h"

using namespace std::chrono_literals;
using urgengo::model::CpuSegments;
using urgengo::model::nanoseconds;

TEST_CASE("CpuSegments begin with the profile and move with what is measured",
          "[model][cpu_segments]") {
    const std::array<nanoseconds, 3> profile{1ms, 2ms, 3ms};
    CpuSegments s(profile);
    CHECK(s.estimate(1) == 2ms);
    CHECK(s.after(0) == 5ms);
    CHECK(s.after(2) == 0ms);
    s.observe(1, 4ms);
    CHECK(s.estimate(1) == 3ms);
    CHECK(s.after(0) == 5ms);  // sums follow at the instance's end
    s.end_instance(3);
    CHECK(s.after(0) == 6ms);
    for (int i = 0; i < 100; ++i) s.observe(1, 8ms);
    CHECK(s.estimate(1) > 7900us);
    const nanoseconds before = s.estimate(1);
    s.observe(1, before + 8ms);  // one of the window's eight
    CHECK(s.estimate(1) == before + 1ms);
}

TEST_CASE("CpuSegments begin empty and grow where an instance ends", "[model][cpu_segments]") {
    CpuSegments s;
    s.observe(0, 5ms);
    CHECK(s.estimate(0) == 0ms);
    CHECK(s.after(7) == 0ms);
    s.end_instance(2);
    s.observe(0, 5ms);
    s.observe(1, 3ms);
    s.end_instance(1);  // a shorter one: what was learned stays
    CHECK(s.estimate(0) == 5ms);
    CHECK(s.after(0) == 3ms);
    s.end_instance(1'000'000);
    CHECK(s.size() == CpuSegments::kMaxSegments);
}

TEST_CASE("A program that was stopped is not taken for slow", "[model][cpu_segments]") {
    const std::array<nanoseconds, 1> profile{2ms};
    CpuSegments s(profile);
    for (int i = 0; i < 20; ++i) s.observe(0, 2ms);
    s.observe(0, 60s);
    CHECK(s.estimate(0) == 2ms + 7ms / 8.0);
}
