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
    const auto k = p.find(2, {fnv1a64("conv"), 22, 512});
    REQUIRE(k);
    CHECK(k->gpu_time == 32us);
    CHECK(k->utilization == 0.21);
}

TEST_CASE("TaskPlan falls back to the mean of the kernel when the position holds another one",
          "[model][task_plan]") {
    const TaskPlan p = plan();
    const auto moved = p.find(1, {fnv1a64("conv"), 22, 512});
    REQUIRE(moved);
    CHECK(moved->gpu_time == 30us);
    CHECK(moved->utilization == Approx(0.20));
    CHECK(p.find(7, {fnv1a64("relu"), 32, 512})->gpu_time == 10us);
}

TEST_CASE("TaskPlan knows no kernel of another name or block size", "[model][task_plan]") {
    const TaskPlan p = plan();
    CHECK_FALSE(p.find(0, {fnv1a64("gemm"), 22, 512}).has_value());
    CHECK_FALSE(p.find(0, {fnv1a64("conv"), 22, 256}).has_value());
}

TEST_CASE("TaskPlan scales a known kernel when its size was never seen", "[model][task_plan]") {
    config::TaskProfile profile;
    profile.kernels = {{"conv", 100, 512, 10us, 0.2}};
    profile.sizes = {{"conv", 300, 512, 20us, 0.5}, {"conv", 100, 512, 10us, 0.2}};
    const TaskPlan p(profile);
    const auto at = [&](std::uint64_t grid) { return p.find(7, {fnv1a64("conv"), grid, 512}); };
    CHECK(at(200)->gpu_time == 15us);
    CHECK(at(200)->utilization == Approx(0.35));
    CHECK(at(50)->gpu_time == 5us);
    CHECK(at(50)->utilization == Approx(0.1));
    CHECK(at(900)->gpu_time == 60us);
    CHECK(at(900)->utilization == 1.0);
    CHECK(at(300)->gpu_time == 20us);
}

TEST_CASE("TaskPlan says where its segments begin and what CPU time comes before them",
          "[model][task_plan]") {
    config::TaskProfile profile;
    profile.kernels = {{"a", 1, 32, 1us, 1}, {"b", 2, 32, 1us, 1}, {"b", 3, 32, 1us, 1}};
    profile.segments = {{1ms, 1, 1, 1, "stream"}, {2ms, 2, 1, 3, "copy"}};
    const TaskPlan p(profile);
    REQUIRE(p.segments().size() == 2);
    CHECK(p.cpu_segments() == std::vector<std::chrono::nanoseconds>{1ms, 2ms});
    CHECK(p.segments()[1].begin == 1);
    CHECK(p.begins_segment(1, {fnv1a64("b"), 2, 32}) == model::Fit::kExact);
    CHECK(p.begins_segment(1, {fnv1a64("b"), 3, 32}) == model::Fit::kOtherSize);
    CHECK(p.begins_segment(1, {fnv1a64("a"), 2, 32}) == model::Fit::kNone);
    profile.segments[1].num_launches = 3;  // more than there are
    CHECK(TaskPlan(profile).segments().empty());
}

TEST_CASE("TaskPlan sums what remains from every position", "[model][task_plan]") {
    const TaskPlan p = plan();
    CHECK(p.gpu_time() == 70us);
    CHECK(p.remaining_from(1) == 42us);
    CHECK(p.remaining_from(2) == 32us);
    CHECK(p.remaining_from(3) == 0us);
    CHECK(p.remaining_from(100) == 0us);
    CHECK(p.cpu_segments() == std::vector<std::chrono::nanoseconds>{5ms});
    CHECK(TaskPlan().gpu_time() == 0us);
}

// The answer of before is asked first; it must not be given where it is another one now.
TEST_CASE("TaskPlan knows how far a budget reaches, whatever it was asked before",
          "[model][task_plan]") {
    config::TaskProfile profile;
    for (int i = 0; i < 7; ++i) profile.kernels.push_back({"k", 1, 32, (i % 3) * 10us, 1});
    TaskPlan p(profile);
    const auto expected = [&](std::size_t position, std::size_t end,
                              std::chrono::nanoseconds budget) {
        end = std::min(end, p.num_kernels());
        while (position < end && budget > 0us) budget -= p.at(position++).gpu_time;
        return position;
    };
    // Each question behind each other one about the same position.
    for (std::size_t position = 0; position <= 8; ++position)
        for (std::size_t before_end = position; before_end <= 9; ++before_end)
            for (int before = -10; before <= 90; before += 5)
                for (std::size_t end = position; end <= 9; ++end)
                    for (int budget = -10; budget <= 90; budget += 5) {
                        p.reach(position, before_end, before * 1us);
                        REQUIRE(p.reach(position, end, budget * 1us) ==
                                expected(position, end, budget * 1us));
                    }
}

namespace {

/// Three launches of 10 us each, so long after the first one.
TaskPlan launched_at(std::chrono::nanoseconds second, std::chrono::nanoseconds third) {
    config::TaskProfile p;
    p.kernels.assign(3, {"conv", 22, 512, 10us, 0.2});
    p.kernels[1].launch_time = second;
    p.kernels[2].launch_time = third;
    return TaskPlan(p);
}

}  // namespace

TEST_CASE("TaskPlan knows what the GPU waits for launches", "[model][task_plan]") {
    const TaskPlan fast = launched_at(2us, 4us);
    CHECK(fast.idle_from(0) == 0us);
    const TaskPlan slow = launched_at(50us, 100us);
    CHECK(slow.idle_from(0) == 80us);  // 110 us alone, 30 of GPU time
    CHECK(slow.idle_from(1) == 90us);  // behind the first launch: 50 + 60 us, 20 of GPU time
    CHECK(slow.idle_from(2) == 50us);
    CHECK(slow.idle_from(3) == 0us);
    CHECK(slow.idle_from(7) == 0us);
    // Work that is launched early covers a late launch.
    CHECK(launched_at(1us, 25us).idle_from(0) == 5us);
}

TEST_CASE("TaskPlan reckons anew with other times", "[model][task_plan]") {
    TaskPlan plan = launched_at(50us, 100us);
    plan.reckon_idle(4, 1);
    CHECK(plan.idle_from(0) == 20us);  // 140 us alone, 120 of GPU time
    plan.reckon_idle(1, 0.1);
    CHECK(plan.idle_from(0) == 0us);
    plan.reckon_idle(1, 2);
    CHECK(plan.idle_from(0) == 180us);
}

TEST_CASE("TaskPlan adds up what segments wait, and no time between them", "[model][task_plan]") {
    config::TaskProfile p;
    p.kernels.assign(4, {"conv", 22, 512, 10us, 0.2});
    p.kernels[1].launch_time = p.kernels[3].launch_time = 50us;
    p.segments = {{1ms, 2, 2, 2, "stream"}, {1ms, 2, 2, 2, "stream"}};
    const TaskPlan plan(p);
    CHECK(plan.idle_from(0) == 80us);
    CHECK(plan.idle_from(1) == 90us);
    CHECK(plan.idle_from(2) == 40us);
    CHECK(plan.idle_from(3) == 50us);
    CHECK(plan.idle_from(4) == 0us);
}

TEST_CASE("TaskPlan takes the gaps between kernels from the latency", "[model][task_plan]") {
    config::TaskProfile p;
    p.kernels.assign(100, {"conv", 22, 512, 10us, 0.2});
    p.segments = {{1ms, 100, 100, 100, "stream", 1150us}};
    const TaskPlan plan(p);
    CHECK(plan.gpu_time() == 1ms);
    CHECK(plan.idle_from(0) == 150us);
    CHECK(plan.idle_from(50) == 75us);
    CHECK(plan.idle_from(100) == 0us);
    // A latency beside others is no gap of 20 us, and one that is too short none at all.
    p.segments[0].latency = 3ms;
    CHECK(TaskPlan(p).idle_from(0) == 200us);
    p.segments[0].latency = 500us;
    CHECK(TaskPlan(p).idle_from(0) == 0us);
}
