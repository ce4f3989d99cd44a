// SPDX-License-Identifier: Apache-2.0
#include "host/sched/urgency_queue.h"

#include <array>
#include <memory>

#include "tests/support/catch.h"
#include "tests/support/governor_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using sched::QueuedLaunch;
using sched::UrgencyQueue;
using sched::Why;

namespace {

std::vector<int> order_of(const UrgencyQueue& queue) {
    std::array<QueuedLaunch, abi::kMaxTasks> launches;
    const std::size_t count = queue.read(launches);
    std::vector<int> tasks;
    for (std::size_t i = 0; i < count; ++i) tasks.push_back(launches[i].task);
    return tasks;
}

}  // namespace

TEST_CASE("Launches stand in the urgency queue in the order of their keys, then of their tasks",
          "[sched][urgency_queue]") {
    const auto page = std::make_unique<abi::SharedPage>();
    UrgencyQueue queue(*page);
    page->active[0] = page->active[2] = ~std::uint64_t{0};
    CHECK(order_of(queue).empty());
    for (const auto& [task, key] : {std::pair{3, 50}, {130, 20}, {7, 50}, {60, 80}})
        queue.stands({.task = task, .why = Why::kRank, .key = key});
    CHECK(order_of(queue) == std::vector{130, 3, 7, 60});
    CHECK(queue.place(130, 20) == 0);
    CHECK(queue.place(7, 50) == 2);
    CHECK(queue.place(60, 80) == 3);

    queue.stands({.task = 130, .why = Why::kRunAhead, .key = 20});  // holds nobody up
    CHECK(queue.place(7, 50) == 1);
    queue.stands({.task = 60, .why = Why::kDrain, .key = 10});  // it has become urgent
    queue.leaves(3);
    queue.leaves(3);
    CHECK(order_of(queue) == std::vector{60, 130, 7});
    std::array<QueuedLaunch, 2> few;
    CHECK(queue.read(few) == 2);
}

TEST_CASE("The urgency queue says since when a launch waits, why, and behind whom",
          "[sched][urgency_queue]") {
    const auto page = std::make_unique<abi::SharedPage>();
    UrgencyQueue queue(*page);
    page->active[0] = 1;
    queue.stands({.task = 0, .why = Why::kRank, .behind = 5, .since = 10ms, .key = 1});
    queue.stands({.task = 0, .why = Why::kRunAhead, .since = 12ms, .key = 2});
    std::array<QueuedLaunch, abi::kMaxTasks> launches;
    REQUIRE(queue.read(launches) == 1);
    CHECK(launches[0].since == 10ms);
    CHECK(launches[0].why == Why::kRunAhead);
    CHECK(launches[0].behind == -1);
    queue.leaves(0);
    queue.stands({.task = 0, .why = Why::kRank, .since = 20ms});
    REQUIRE(queue.read(launches) == 1);
    CHECK(launches[0].since == 20ms);
}

TEST_CASE("A held launch stands in the urgency queue until it goes", "[sched][urgency_queue]") {
    config::Scheduler scheduler;
    scheduler.policy = config::Policy::kEdf;
    GovernorFixture f({300ms, 50ms, 200ms}, scheduler);
    for (int i : {0, 1, 2}) f.begin(i, 20ms);
    f.launch(1, 500us);
    const UrgencyQueue& queue = f.governor.queue();
    for (int i : {0, 2}) {
        const sched::Answer held = f.ask(i);
        REQUIRE(held.wait);
        f.sleep(i, *held.wait);
    }
    CHECK(order_of(queue) == std::vector{2, 0});

    f.execute(1);
    f.slot(1).state = abi::TaskState::kIdle;
    f.page->active[0] = 0b101;
    f.governor.leaves_gpu(f.task(1), f.now);
    CHECK_FALSE(f.ask(2).wait);
    CHECK(order_of(queue) == std::vector{0});
    f.governor.queue().leaves(f.task(0).index);
    CHECK(order_of(queue).empty());
}
