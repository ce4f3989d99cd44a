// SPDX-License-Identifier: Apache-2.0
//
// Where the GPU is in the work of a task that the config names.
#include "host/runtime/task_progress.h"

#include "tests/support/common_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

TEST_CASE("TaskProgress tells of tasks that have launched, by their names",
          "[runtime][task_progress]") {
    CommonFixture f;
    runtime::TaskProgress& progress = f.common().progress;
    CHECK_FALSE(progress.position("tight", "detect"));
    f.tight().log.launched(100us, {.time = f.clock.now(), .position = 4});
    const auto at = progress.position("tight", "detect");
    REQUIRE(at);
    CHECK(at->at.position == 4);
    CHECK_FALSE(progress.position("tight", "track"));
    CHECK_FALSE(progress.position("none", "detect"));
    CHECK_FALSE(progress.position("loose", "detect"));
}

TEST_CASE("TaskProgress learns the GPU's clock from a mark that a look has seen",
          "[runtime][task_progress]") {
    CommonFixture f;
    runtime::TaskState& task = f.tight();
    ug_mark_line line{};
    line.clock = UG_MARK_CLOCK_GPU;
    task.line = &line;
    task.log.launched(100us, {.time = f.clock.now()});
    task.log.marked(f.clock.now(), 1);
    task.slot->marks_issued = 1;
    f.clock.advance(100us);
    line.word[0] = ug_mark_word0(1, 0, 1);
    line.word[1] = ug_mark_word1(static_cast<std::uint64_t>(f.clock.now().count()), 1);
    CHECK(f.common().progress.gpu_clock().restarts() == 0);
    f.common().progress.progressed(task, {}, line, f.clock.now());
    CHECK(f.common().progress.gpu_clock().restarts() == 1);
}
