// SPDX-License-Identifier: Apache-2.0
//
// Histograms of our own time: percentiles within their bins, mean and maximum exact.
#include "interposer/own_time_histogram.h"

#include <memory>
#include <vector>

#include "tests/support/catch.h"

using urgengo::own_time::Histogram;

TEST_CASE("A histogram of nothing is 0", "[unit][interposer]") {
    const auto times = std::make_unique<Histogram>();
    CHECK(times->count() == 0);
    CHECK(times->mean() == 0);
    CHECK(times->percentile(0.99) == 0);
}

TEST_CASE("A histogram finds percentiles within 3 %", "[unit][interposer]") {
    const auto times = std::make_unique<Histogram>();
    for (std::uint64_t i = 1; i <= 100'000; ++i) times->add(i * 37);
    CHECK(times->count() == 100'000);
    CHECK(times->mean() == Approx(37 * 50'000.5));
    CHECK(times->max() == 3'700'000);
    for (const double share : {0.001, 0.5, 0.9, 0.99, 0.9999})
        CHECK(times->percentile(share) == Approx(share * 3'700'000).epsilon(0.03));
    CHECK(times->percentile(1) == Approx(3'700'000).epsilon(0.03));
}

TEST_CASE("A histogram keeps small values and bounds large ones", "[unit][interposer]") {
    const auto times = std::make_unique<Histogram>();
    for (const std::uint64_t value : {0, 1, 31, 32, 33}) times->add(value);
    CHECK(times->percentile(0.2) == 0);
    CHECK(times->percentile(0.4) == 1);
    CHECK(times->percentile(0.6) == 31);
    CHECK(times->percentile(0.8) == 32);
    CHECK(times->percentile(1) == 33);
    times->add(UINT64_MAX / 2);  // beyond the last bin
    CHECK(times->max() == UINT64_MAX / 2);
    CHECK(times->percentile(1) > 1e12);
}

TEST_CASE("The one in ten thousand is not lost", "[unit][interposer]") {
    const auto times = std::make_unique<Histogram>();
    for (int i = 0; i < 19'997; ++i) times->add(100);
    for (int i = 0; i < 3; ++i) times->add(1'000'000);
    CHECK(times->percentile(0.999) == Approx(100).epsilon(0.03));
    CHECK(times->percentile(0.9999) == Approx(1'000'000).epsilon(0.03));
}

TEST_CASE("A histogram's bins are all of its values", "[unit][interposer]") {
    const auto times = std::make_unique<Histogram>();
    for (int i = 0; i < 10; ++i) times->add(7);
    times->add(100'000);
    times->add(UINT64_MAX / 2);
    std::vector<double> middles;
    std::uint64_t count = 0;
    times->each_bin([&](double middle, std::uint64_t values) {
        middles.push_back(middle);
        count += values;
    });
    REQUIRE(middles.size() == 3);
    CHECK(middles[0] == 7);
    CHECK(middles[1] == Approx(100'000).epsilon(0.03));
    CHECK(count == times->count());
}

TEST_CASE("Merged histograms are one of all values", "[unit][interposer]") {
    const auto one = std::make_unique<Histogram>(), other = std::make_unique<Histogram>();
    one->add(10);
    other->add(30);
    other->add(20);
    one->merge(*other);
    CHECK(one->count() == 3);
    CHECK(one->mean() == 20);
    CHECK(one->max() == 30);
    CHECK(one->percentile(0.5) == 20);
}
