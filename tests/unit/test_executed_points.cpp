// SPDX-License-Identifier: Apache-2.0
#include "host/model/executed_points.h"

#include <atomic>
#include <set>
#include <thread>
#include <vector>

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using model::ExecutedPoints;
using std::chrono::nanoseconds;

TEST_CASE("Points of marks are kept until the ring has come round", "[model][executed_points]") {
    ExecutedPoints points;
    const auto kept = [&] {
        std::set<std::int64_t> works;
        points.for_each([&](const ExecutedPoints::Point& point) {
            CHECK(point.time == 2 * point.work);
            works.insert(point.work.count());
        });
        return works;
    };
    const auto add = [&](std::uint32_t mark) {
        points.add(mark, {nanoseconds(2LL * mark), nanoseconds(mark)});
    };
    CHECK(kept().empty());
    add(7);
    add(5);  // seen later
    CHECK(kept() == std::set<std::int64_t>{5, 7});
    for (std::uint32_t mark = 100; mark < 100 + ExecutedPoints::kRing; ++mark) add(mark);
    const auto all = kept();
    CHECK(all.size() == ExecutedPoints::kRing);
    CHECK(*all.begin() == 100);
}

TEST_CASE("Point of mark 0, of a counter that has come round, is one", "[model][executed_points]") {
    ExecutedPoints points;
    points.add(0, {nanoseconds(3), nanoseconds(4)});
    int num_points = 0;
    points.for_each([&](const ExecutedPoints::Point&) { ++num_points; });
    CHECK(num_points == 1);
}

TEST_CASE("Point that is written meanwhile is whole, or left out", "[model][executed_points]") {
    ExecutedPoints points;
    std::atomic<bool> is_over{false};
    std::thread writer([&] {
        for (std::uint32_t mark = 1; mark < 2'000 * ExecutedPoints::kRing; ++mark)
            points.add(mark, {nanoseconds(2LL * mark), nanoseconds(mark)});
        is_over = true;
    });
    int torn = 0;
    while (!is_over)
        points.for_each(
            [&](const ExecutedPoints::Point& point) { torn += point.time != 2 * point.work; });
    writer.join();
    CHECK(torn == 0);
}

TEST_CASE("Points of the last marks come in their order", "[model][executed_points]") {
    ExecutedPoints points;
    const auto last = [&](std::uint32_t newest, std::uint32_t most) {
        std::vector<nanoseconds> works;
        points.for_each_of_last(
            newest, most, [&](const ExecutedPoints::Point& point) { works.push_back(point.work); });
        return works;
    };
    for (std::uint32_t mark = 1020; mark <= 1030; ++mark)
        if (mark != 1029) points.add(mark, {nanoseconds(mark), nanoseconds(mark)});
    CHECK(last(1030, 3) == std::vector<nanoseconds>{1028ns, 1030ns});
    CHECK(last(1030, 10'000).size() == 10);
    CHECK(last(1030, 0).empty());
}
