// SPDX-License-Identifier: Apache-2.0
#include "host/sched/urgent_threshold.h"

#include "tests/support/catch.h"

using namespace std::chrono_literals;
using urgengo::sched::UrgentThreshold;

namespace {

double threshold_ms(const UrgentThreshold& threshold) {
    return static_cast<double>(threshold.laxity().value().count()) * 1e-6;
}

}  // namespace

TEST_CASE("There is no threshold before enough urgencies are recorded", "[sched][urgent]") {
    UrgentThreshold threshold(95);
    for (std::uint32_t i = 1; i < UrgentThreshold::kEnough; ++i) threshold.record(10ms);
    CHECK_FALSE(threshold.laxity());
    threshold.record(10ms);
    CHECK(threshold.laxity());
}

TEST_CASE("The threshold is the percentile of urgencies, to a sixteenth", "[sched][urgent]") {
    for (const double percentile : {95.0, 50.0, 90.0}) {
        UrgentThreshold threshold(percentile);
        for (int ms = 1; ms <= 100; ++ms) {  // 95 % of urgencies are below 1 / (5 ms)
            threshold.record(std::chrono::milliseconds(ms));
            threshold.record(std::chrono::milliseconds(ms));
        }
        CHECK(threshold_ms(threshold) == Approx(100 - percentile + 1).epsilon(0.08));
    }
}

TEST_CASE("The threshold follows what is recorded, now and then", "[sched][urgent]") {
    UrgentThreshold threshold(90);
    for (std::uint32_t i = 0; i < UrgentThreshold::kEnough; ++i) threshold.record(10ms);
    CHECK(threshold_ms(threshold) == Approx(10).epsilon(0.08));
    for (std::uint32_t i = 1; i < UrgentThreshold::kEnough; ++i) threshold.record(1ms);
    CHECK(threshold_ms(threshold) == Approx(10).epsilon(0.08));  // not at every record
    threshold.record(1ms);
    CHECK(threshold_ms(threshold) == Approx(1).epsilon(0.08));
}

TEST_CASE("A laxity of nothing and one of years are urgencies, too", "[sched][urgent]") {
    UrgentThreshold threshold(100);
    for (std::uint32_t i = 0; i < UrgentThreshold::kEnough; ++i)
        threshold.record(i % 2 == 0 ? 0ns : std::chrono::nanoseconds::max());
    CHECK(threshold_ms(threshold) < 1e-3);
}

TEST_CASE("Urgencies are recorded a millisecond apart, by one caller", "[sched][urgent]") {
    UrgentThreshold threshold(95);
    CHECK(threshold.is_due(0ns));
    CHECK_FALSE(threshold.is_due(999'999ns));
    CHECK(threshold.is_due(1ms));
    CHECK_FALSE(threshold.is_due(1ms));
}
