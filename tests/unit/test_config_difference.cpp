// SPDX-License-Identifier: Apache-2.0
#include "host/config/config_difference.h"

#include "tests/support/catch.h"
#include "tests/support/lidar_and_camera.h"

using namespace urgengo::config;
using namespace std::chrono_literals;

namespace {

Config two_chains() {
    return urgengo::testing::lidar_and_camera(80ms, 80ms, {{"detect", "th_*"}, {"track", ""}});
}

using Texts = std::vector<std::string>;

}  // namespace

TEST_CASE("Configs that are the same differ in nothing", "[config][difference]") {
    const ConfigDifference found = difference(two_chains(), two_chains());
    CHECK(found.changed.empty());
    CHECK(found.refused.empty());
}

TEST_CASE("What can change while a program runs is told, with what it was",
          "[config][difference]") {
    Config next = two_chains();
    next.mode = Mode::kObserve;
    next.chains[0].deadline = 62500us;
    next.chains[0].criticality = 4;
    next.chains[1].period = 50ms;
    next.chains[1].on_late = OnLate::kDemote;
    next.chains[1].mode = Mode::kObserve;
    next.chains[1].max_consecutive_misses = 3;
    const ConfigDifference found = difference(two_chains(), next);
    CHECK(found.refused.empty());
    CHECK(found.changed ==
          Texts{"chain 'lidar': criticality 1 -> 4", "chain 'lidar': deadline_ms 80.0 -> 62.5",
                "chain 'camera': max_consecutive_misses 0 -> 3",
                "chain 'camera': mode enforce -> observe",
                "chain 'camera': on_late continue -> demote",
                "chain 'camera': period_ms 100.0 -> 50.0", "mode enforce -> observe"});
    CHECK(joined({"a", "b"}) == "a; b");
}

TEST_CASE("What cannot change while a program runs is refused", "[config][difference]") {
    Config next = two_chains();
    Texts refused;
    SECTION("chains that come, go, or have other names") {
        next.chains[1].name = "radar";
        refused = {"chain 'camera' is gone", "chain 'radar' is new"};
    }
    SECTION("their order") {
        std::swap(next.chains[0], next.chains[1]);
        refused = {"the chains are in another order"};
    }
    SECTION("tasks") {
        const bool is_new = GENERATE(false, true);
        if (is_new)
            next.chains[0].tasks.push_back({"plan", ""});
        else
            next.chains[0].tasks[1].thread_glob = "tr_*";
        refused = {"chain 'lidar': tasks"};
    }
    SECTION("where frames arrive, and a chain that was off, or is to be") {
        next.chains[0].arrival = ArrivalFrom::kHint;
        next.chains[1].mode = Mode::kOff;
        refused = {"chain 'lidar': arrival first_call -> hint",
                   "chain 'camera': mode enforce -> off"};
    }
    SECTION("the scheduler, and what the process has begun with") {
        next.scheduler.parameters.lambda = 0.5;
        next.scheduler.hold.poll = 70us;
        next.connections = 8;
        next.blocking_sync = true;
        refused = {"blocking_sync false -> true", "connections -1 -> 8",
                   "scheduler: hold_poll_ms 0.05 -> 0.07", "scheduler: lambda 1.0 -> 0.5"};
    }
    next.chains[0].deadline = 20ms;  // that could change
    CHECK(difference(two_chains(), next).refused == refused);
}

TEST_CASE("Priorities' way that is not resolved is the one that there is", "[config][difference]") {
    Config now = two_chains(), next = two_chains();
    now.scheduler.priority.via = PriorityVia::kStreamPool;
    CHECK(difference(now, next).refused.empty());
    next.scheduler.priority.via = PriorityVia::kLaunchAttribute;
    CHECK(difference(now, next).refused.size() == 1);
}
