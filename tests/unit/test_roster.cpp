// SPDX-License-Identifier: Apache-2.0
//
// The config's chains and tasks as the runtime keeps them.
#include "host/runtime/roster.h"

#include "tests/support/common_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

TEST_CASE("Roster has the config's chains and tasks, in its order", "[runtime][roster]") {
    CommonFixture f;
    f.resolved.config.chains[1].tasks.push_back({"plan", "th_plan"});
    const runtime::Roster& roster = f.common().roster;
    REQUIRE(roster.chains().size() == 2);
    REQUIRE(roster.tasks().size() == 3);
    for (int i = 0; i < 3; ++i) {
        const runtime::TaskState& task = roster.task(i);
        CHECK(task.index == i);
        CHECK(task.slot == &f.common().page().tasks[i]);
        CHECK(&f.common().governor.tasks()[i] == &task);
    }
    CHECK(roster.chains()[1]->tasks == std::vector{1, 2});
    CHECK(roster.task(2).stage == 1);
    CHECK(roster.task(2).chain == roster.chains()[1].get());
    CHECK(f.common().page().num_tasks == 3);
}

TEST_CASE("Roster finds chains and tasks by their names", "[runtime][roster]") {
    CommonFixture f;
    const runtime::Roster& roster = f.common().roster;
    const runtime::ChainState* const loose = roster.find_chain("loose");
    REQUIRE(loose == roster.chains()[1].get());
    CHECK(roster.find_task(*loose, "detect") == &f.loose());
    CHECK(roster.find_task(*loose, "track") == nullptr);
    CHECK(roster.find_chain("none") == nullptr);
}

TEST_CASE("Roster gives tasks their plans, and knows whether any has graphs", "[runtime][roster]") {
    CommonFixture f;
    f.resolved.profile->chains.erase(f.resolved.profile->chains.begin());
    SECTION("without graphs") {
        CHECK(f.tight().plan.is_empty());
        CHECK(f.loose().plan.num_kernels() == 20);
        CHECK(f.loose().estimated.gpu_ns == std::chrono::nanoseconds(2ms).count());
        CHECK_FALSE(f.common().roster.has_graphs());
    }
    SECTION("with one") {
        f.resolved.profile->chains[0].tasks[0].kernels[3].name = "(graph of 53 kernels, 8f3a12bc)";
        CHECK(f.common().roster.has_graphs());
        CHECK(f.common().kernels.looks_into_graphs());
    }
    SECTION("of a chain that the config does not have") {
        f.resolved.profile->chains[0].tasks[0].kernels[3].name = "(graph)";
        f.resolved.profile->chains[0].name = "other";
        CHECK_FALSE(f.common().roster.has_graphs());
    }
}
