// SPDX-License-Identifier: Apache-2.0
#include "host/model/task_set.h"

#include <vector>

#include "tests/support/catch.h"

using urgengo::model::SharedTaskSet;
using urgengo::model::TaskSet;

TEST_CASE("Set of tasks holds every slot, and nothing that is none", "[model][task_set]") {
    TaskSet set;
    CHECK(set.is_empty());
    for (int task = 0; task < urgengo::abi::kMaxTasks; ++task) {
        CHECK_FALSE(set.contains(task));
        set.insert(task);
        CHECK(set.contains(task));
    }
    set.insert(-1);  // SlotView::kExpected
    set.insert(urgengo::abi::kMaxTasks);
    CHECK_FALSE(set.contains(-1));
    CHECK_FALSE(set.contains(urgengo::abi::kMaxTasks));
    set.erase(200);
    CHECK_FALSE(set.contains(200));
    CHECK(set.contains(199));
}

TEST_CASE("Set of tasks names its members in order", "[model][task_set]") {
    std::vector<int> found;
    TaskSet{255, 0, 64, 63, 130}.for_each([&](int task) { found.push_back(task); });
    CHECK(found == std::vector{0, 63, 64, 130, 255});
    CHECK((TaskSet{1, 200} & TaskSet{200, 201}) == TaskSet{200});
}

TEST_CASE("Shared set of tasks is read as it was written", "[model][task_set]") {
    SharedTaskSet shared;
    CHECK(shared.is_empty());
    shared.store({3, 100, 255});
    CHECK(shared.load() == TaskSet{3, 100, 255});
    shared.insert(64);
    shared.erase(100);
    CHECK(shared.contains(64));
    CHECK(shared.load() == TaskSet{3, 64, 255});
}
