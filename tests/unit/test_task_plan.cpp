// SPDX-License-Identifier: Apache-2.0
#include "host/model/task_plan.h"

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using model::KernelKey;
using model::TaskPlan;

namespace {

TaskPlan plan() {
    config::TaskProfile p;
    p.name = "detect";
    p.cpu_time = 5ms;
    p.kernels = {
        {"conv", 22, 512, 28us, 0.19}, {"relu", 32, 512, 10us, 0.5}, {"conv", 22, 512, 32us, 0.21}};
    return TaskPlan(p);
}

}  // namespace

TEST_CASE("TaskPlan answers the launch that stands at the position", "[model][task_plan]") {
    const TaskPlan p = plan();
    const auto* k = p.find(2, {fnv1a64("conv"), 22, 512});
    REQUIRE(k);
    CHECK(k->gpu_time == 32us);
    CHECK(k->utilization == 0.21);
}

TEST_CASE("TaskPlan falls back to the mean of the kernel when the position holds another one",
          "[model][task_plan]") {
    const TaskPlan p = plan();
    const auto* moved = p.find(1, {fnv1a64("conv"), 22, 512});
    REQUIRE(moved);
    CHECK(moved->gpu_time == 30us);
    CHECK(moved->utilization == Approx(0.20));
    CHECK(p.find(7, {fnv1a64("relu"), 32, 512})->gpu_time == 10us);
}

TEST_CASE("TaskPlan knows no kernel of another name or size", "[model][task_plan]") {
    const TaskPlan p = plan();
    CHECK(p.find(0, {fnv1a64("gemm"), 22, 512}) == nullptr);
    CHECK(p.find(0, {fnv1a64("conv"), 23, 512}) == nullptr);
    CHECK(p.find(0, {fnv1a64("conv"), 22, 256}) == nullptr);
}

TEST_CASE("TaskPlan sums what remains from every position", "[model][task_plan]") {
    const TaskPlan p = plan();
    CHECK(p.gpu_time() == 70us);
    CHECK(p.remaining_from(1) == 42us);
    CHECK(p.remaining_from(2) == 32us);
    CHECK(p.remaining_from(3) == 0us);
    CHECK(p.remaining_from(100) == 0us);
    CHECK(p.cpu_time() == 5ms);
    CHECK(TaskPlan().gpu_time() == 0us);
}
