// SPDX-License-Identifier: Apache-2.0
#include "host/sched/awaited_work.h"

#include <utility>
#include <vector>

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using sched::AwaitedWork;
using sched::nanoseconds;

namespace {

std::vector<std::pair<int, nanoseconds>> before(const AwaitedWork& awaited, nanoseconds own) {
    std::vector<std::pair<int, nanoseconds>> found;
    awaited.for_each_before(own,
                            [&](int task, nanoseconds until) { found.emplace_back(task, until); });
    return found;
}

}  // namespace

TEST_CASE("Awaited work is that of waits with work behind them", "[sched][lent_deadline]") {
    AwaitedWork awaited;
    CHECK(before(awaited, 1s).empty());
    awaited.add(3, 20ms, 5ms);
    CHECK(before(awaited, 4ms).empty());
    CHECK(before(awaited, 5ms).empty());
    CHECK(before(awaited, 6ms) == std::vector{std::pair{3, nanoseconds(20ms)}});
}

TEST_CASE("Awaited work has one entry for waits of one place and task", "[sched][lent_deadline]") {
    AwaitedWork awaited;
    for (int i = 0; i < 6; ++i) awaited.add(3, i * 1ms, 5ms);
    awaited.add(3, 1ms, 5ms);
    awaited.add(4, 9ms, 5ms);
    CHECK(before(awaited, 6ms) ==
          std::vector{std::pair{3, nanoseconds(5ms)}, std::pair{4, nanoseconds(9ms)}});
}

TEST_CASE("Awaited work keeps the last few waits", "[sched][lent_deadline]") {
    AwaitedWork awaited;
    for (int i = 0; i < 6; ++i) awaited.add(i, i * 1ms, 0ms);
    const auto found = before(awaited, 1ms);
    REQUIRE(found.size() == AwaitedWork::kRemembered);
    int sum = 0;
    for (const auto& [task, until] : found) sum += task;
    CHECK(sum == 2 + 3 + 4 + 5);
}
