// SPDX-License-Identifier: Apache-2.0
//
// Which instances run side by side while a plan of the policy `feasible` stands.
#include "host/sched/policies/feasible.h"

#include <vector>

#include "tests/support/catch.h"
#include "tests/support/slot_views.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
using model::SlotView;

namespace {

constexpr sched::nanoseconds kShareSlack{5ms};

std::vector<int> may_share(const std::vector<SlotView>& tasks) {
    return slots_of(sched::make_plan(0ns, tasks, 0, kShareSlack).may_share);
}

}  // namespace

TEST_CASE("Who is kept may share with those before it that have time, whoever is behind it",
          "[sched][policy]") {
    // They end by 10, 20 and 60 ms: 20, 40 and 4 ms before their deadlines.
    CHECK(may_share({job(0, 30ms, 10ms), job(1, 60ms, 10ms), job(2, 64ms, 40ms)}) ==
          std::vector{0, 1, 2});
    CHECK(may_share({job(0, 14ms, 10ms), job(1, 60ms, 10ms), job(2, 70ms, 40ms)}) ==
          std::vector{0});
    CHECK(may_share({job(0, 15ms, 10ms), job(1, 24ms, 10ms), job(2, 70ms, 40ms)}) ==
          std::vector{0, 1});
    // Of two that are due at once either may be the first.
    CHECK(may_share({job(0, 30ms, 10ms), job(1, 30ms, 17ms)}) == std::vector{1});
}

TEST_CASE("Who shares leaves time to those that are yet to come", "[sched][policy]") {
    // The other one needs the GPU from 20 to 30 ms, and is done 2 ms before its deadline.
    const auto other = [](int index) { return later_job(index, 20ms, 32ms, 10ms); };
    CHECK(may_share({job(0, 25ms, 10ms), job(1, 60ms, 10ms), other(2)}) == std::vector{0, 2});
    CHECK(may_share({job(0, 25ms, 10ms), job(1, 31ms, 10ms), other(2)}) == std::vector{0, 1, 2});
    CHECK(may_share({job(0, 25ms, 10ms), job(1, 60ms, 10ms), other(SlotView::kExpected)}) ==
          std::vector{0});
    // What counts is the end of all: 10 ms, 20 ms on the CPU, 10 ms.
    CHECK(may_share({two_part_job(0, 44ms, 10ms, 20ms), job(1, 50ms, 5ms)}) == std::vector{0});
}

TEST_CASE("Nobody shares who is given up, or with whom nobody knows the needs of",
          "[sched][policy]") {
    CHECK(may_share({job(0, 40ms, 30ms), job(1, 41ms, 29ms), job(2, 80ms, 10ms)}) ==
          std::vector{1, 2});
    std::vector tasks{job(0, 30ms, 10ms), job(1, 65ms, 20ms)};
    CHECK(may_share(tasks) == std::vector{0, 1});
    tasks[1].chain.gpu = 0ns;
    CHECK(may_share(tasks).empty());
}

TEST_CASE("Launch-bound instances share with less time to spare", "[sched][policy]") {
    // Each needs the GPU for 3 of 6 ms, of which half may meet the other's work.
    CHECK(may_share({half_busy_job(0, 7600us, 6ms), half_busy_job(1, 20ms, 6ms)}) ==
          std::vector{0, 1});
    CHECK(may_share({half_busy_job(0, 7400us, 6ms), half_busy_job(1, 20ms, 6ms)}) ==
          std::vector{0});
    // The other one would have the GPU all the time.
    CHECK(may_share({half_busy_job(0, 10800us, 6ms), job(1, 20ms, 3ms)}) == std::vector{0});
    CHECK(may_share({half_busy_job(0, 11200us, 6ms), job(1, 20ms, 3ms)}) == std::vector{0, 1});
    // Towards its end, 0.25 ms where two that keep the GPU busy leave 3 ms.
    CHECK(may_share({half_busy_job(0, 460us, 200us), half_busy_job(1, 20ms, 6ms)}) ==
          std::vector{0, 1});
    CHECK(may_share({half_busy_job(0, 440us, 200us), half_busy_job(1, 20ms, 6ms)}) ==
          std::vector{0});
    CHECK(may_share({job(0, 3400us, 200us), job(1, 20ms, 6ms)}) == std::vector{0, 1});
    CHECK(may_share({job(0, 3200us, 200us), job(1, 20ms, 6ms)}) == std::vector{0});
}

TEST_CASE("Instances share while they have time for half of what remains, and what is under way",
          "[sched][policy]") {
    const auto may = [](SlotView first) {
        const std::vector tasks{first, job(1, 60ms, 10ms)};
        return slots_of(sched::make_plan(0ns, tasks, 0, 10ms).may_share).size() == 2;
    };
    CHECK(may(job(0, 12100us, 6ms)));
    CHECK_FALSE(may(job(0, 11900us, 6ms)));
    CHECK(may(job(0, 4600us, 1ms)));
    CHECK_FALSE(may(job(0, 4400us, 1ms)));
    CHECK(may(job(0, 30100us, 20ms)));  // no more than share_slack
    // One that is launch-bound needs as much as remains.
    CHECK(may(half_busy_job(0, 4200us, 2ms)));
    CHECK_FALSE(may(half_busy_job(0, 3800us, 2ms)));
}
