// SPDX-License-Identifier: Apache-2.0
//
// The workload's arrivals: the same for the same seed whatever happens, and spread as the paper
// says.
#include <algorithm>

#include "tests/support/catch.h"
#include "tools/chains/arrivals.h"

using namespace urgengo::chains;
using namespace std::chrono_literals;
using std::chrono::nanoseconds;

namespace {

Chain two_task_chain() {
    Chain chain;
    chain.name = "C0";
    chain.tasks.resize(2);
    chain.tasks[0].cpu_ms = 10;
    chain.tasks[1].cpu_ms = 4;
    return chain;
}

ArrivalSettings ten_seconds(std::uint32_t seed) {
    return {seed, 150ms, 10s};
}

}  // namespace

TEST_CASE("plan_frames repeats itself when seed and parameters are the same", "[unit][chains]") {
    const auto first = plan_frames(two_task_chain(), 3, ten_seconds(1));
    const auto again = plan_frames(two_task_chain(), 3, ten_seconds(1));
    REQUIRE(first.size() == again.size());
    for (std::size_t i = 0; i < first.size(); i++) {
        REQUIRE(first[i].arrival == again[i].arrival);
        REQUIRE(first[i].cpu == again[i].cpu);
    }
}

TEST_CASE("plan_frames differs when the seed or the chain differs", "[unit][chains]") {
    const auto frames = plan_frames(two_task_chain(), 3, ten_seconds(1));
    CHECK(frames[0].arrival != plan_frames(two_task_chain(), 3, ten_seconds(2))[0].arrival);
    CHECK(frames[0].arrival != plan_frames(two_task_chain(), 4, ten_seconds(1))[0].arrival);
}

TEST_CASE("plan_frames starts with the same frames when the run is longer", "[unit][chains]") {
    ArrivalSettings longer = ten_seconds(1);
    longer.duration = 20s;
    const auto frames = plan_frames(two_task_chain(), 0, ten_seconds(1));
    const auto more = plan_frames(two_task_chain(), 0, longer);
    REQUIRE(more.size() > frames.size());
    for (std::size_t i = 0; i < frames.size(); i++) REQUIRE(frames[i].arrival == more[i].arrival);
}

TEST_CASE("plan_frames keeps period, jitter and CPU times in their bounds", "[unit][chains]") {
    const std::uint32_t seed = GENERATE(1u, 2u, 3u, 4u, 5u);
    CAPTURE(seed);
    const auto frames = plan_frames(two_task_chain(), 0, ten_seconds(seed));
    REQUIRE(frames.size() >= 65);
    REQUIRE(frames.size() <= 67);
    REQUIRE(frames[0].arrival >= 0ms);
    REQUIRE(frames[0].arrival < 165ms);
    nanoseconds earliest = 1h, latest = 0ms;  // lateness against the period, from a common phase
    for (std::size_t i = 0; i < frames.size(); i++) {
        const nanoseconds lateness = frames[i].arrival - i * 150ms;
        earliest = std::min(earliest, lateness);
        latest = std::max(latest, lateness);
        REQUIRE(frames[i].arrival < 10s);
        REQUIRE(frames[i].cpu.size() == 2);
        REQUIRE(frames[i].cpu[0] >= 9ms);
        REQUIRE(frames[i].cpu[0] <= 11ms);
        REQUIRE(frames[i].cpu[1] >= 3600us);
        REQUIRE(frames[i].cpu[1] <= 4400us);
    }
    CHECK(latest - earliest <= 15ms);
    CHECK(latest - earliest > 10ms);
}

TEST_CASE("plan_frames is in order of arrival when frames come faster than the jitter",
          "[unit][chains]") {
    const auto frames = plan_frames(two_task_chain(), 0, {1, 2ms, 1s});
    for (std::size_t i = 1; i < frames.size(); i++) {
        REQUIRE(frames[i - 1].arrival <= frames[i].arrival);
    }
}

TEST_CASE("plan_frames varies inputs only, and within their range, when asked", "[unit][chains]") {
    Chain chain = two_task_chain();
    chain.tasks[0].min_inputs = 22000;
    chain.tasks[0].max_inputs = 65000;
    ArrivalSettings settings = ten_seconds(1);
    const auto fixed = plan_frames(chain, 8, settings);
    settings.variable = true;
    const auto varied = plan_frames(chain, 8, settings);
    REQUIRE(fixed.size() == varied.size());
    double least = 2, most = 0, sum = 0;
    for (std::size_t i = 0; i < fixed.size(); i++) {
        REQUIRE(fixed[i].size == std::vector<double>{1, 1});
        REQUIRE(varied[i].arrival == fixed[i].arrival);
        REQUIRE(varied[i].cpu == fixed[i].cpu);
        REQUIRE(varied[i].size[1] == 1);
        least = std::min(least, varied[i].size[0]);
        most = std::max(most, varied[i].size[0]);
        sum += varied[i].size[0];
    }
    CHECK(least >= 22000 / 43500.0);
    CHECK(least < 0.6);
    CHECK(most <= 65000 / 43500.0);
    CHECK(most > 1.4);
    CHECK(sum / double(varied.size()) == Approx(1).margin(0.1));
    CHECK(varied[0].size != plan_frames(chain, 7, settings)[0].size);
    settings.seed = 2;
    CHECK(varied[0].size != plan_frames(chain, 8, settings)[0].size);
}
