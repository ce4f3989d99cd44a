// SPDX-License-Identifier: Apache-2.0
#include "host/model/estimate_factor.h"

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using model::EstimateFactor;

namespace {

using Instance = EstimateFactor::Instance;

/// Instances of a task that the plan says takes 10 ms.
double after(int instances, Instance instance) {
    EstimateFactor factor;
    instance.estimated = 10ms;
    for (int i = 0; i < instances; ++i) factor.observe(instance);
    return factor.value();
}

}  // namespace

TEST_CASE("EstimateFactor believes that work is shorter, whoever else is there", "[model]") {
    CHECK(after(2, {.most = 2500us, .least = 1ms}) == 1);  // one may have skipped work
    CHECK(after(3, {.most = 2500us, .least = 1ms}) == Approx(0.25));
}

TEST_CASE("EstimateFactor does not believe that work is longer where others are", "[model]") {
    CHECK(after(50, {.most = 40ms, .least = 39ms}) == 1);
}

TEST_CASE("EstimateFactor believes that work is longer where nobody else is", "[model]") {
    CHECK(after(20, {.most = 40ms, .least = 38ms, .alone = true}) == Approx(3.8).epsilon(0.01));
    CHECK(after(4, {.most = 80ms, .least = 80ms, .alone = true}) == 1);
    CHECK(after(5, {.most = 80ms, .least = 80ms, .alone = true}) == 2);  // at most doubled
}

TEST_CASE("EstimateFactor does not take a busy core for a busy GPU", "[model]") {
    EstimateFactor factor;
    for (int i = 0; i < 100; ++i) {
        const auto took = i % 4 == 0 ? 10ms : 60ms;
        factor.observe({.estimated = 10ms, .most = took, .least = took, .alone = true});
    }
    CHECK(factor.value() == 1);
}

TEST_CASE("EstimateFactor takes what unknown kernels took at their shortest", "[model]") {
    // 82 kernels of 400 us, which count for 20 us each, beside others that share the GPU.
    EstimateFactor factor;
    for (const auto took : {47ms, 38ms, 61ms, 35ms, 47ms})
        factor.observe_unknown({.estimated = 1640us, .most = took, .waited = took - 1ms});
    CHECK(factor.value() == Approx(35 / 1.64));
    for (int i = 0; i < 16; ++i)
        factor.observe_unknown({.estimated = 1640us, .most = 45ms, .waited = 44ms});
    CHECK(factor.value() == Approx(45 / 1.64));
}

TEST_CASE("EstimateFactor learns nothing of unknown kernels from a thread that did not wait",
          "[model]") {
    EstimateFactor factor;
    for (int i = 0; i < 16; ++i)
        factor.observe_unknown({.estimated = 1ms, .most = 40ms, .waited = 15ms});
    CHECK(factor.value() == 1);
    for (int i = 0; i < 2; ++i)
        factor.observe_unknown({.estimated = 1ms, .most = 40ms, .waited = 39ms});
    CHECK(factor.value() == 1);  // two may be chance
}

TEST_CASE("EstimateFactor believes that unknown kernels are shorter, however they were launched",
          "[model]") {
    EstimateFactor factor;
    for (int i = 0; i < 3; ++i) factor.observe_unknown({.estimated = 5200us, .most = 2600us});
    CHECK(factor.value() == Approx(0.5));
}

TEST_CASE("EstimateFactor of unknown kernels is not thrown back by an instance that did not wait",
          "[model]") {
    EstimateFactor factor;
    for (int i = 0; i < 16; ++i)
        factor.observe_unknown({.estimated = 1ms, .most = 100ms, .waited = 99ms});
    REQUIRE(factor.value() == Approx(100));
    factor.observe_unknown({.estimated = 1ms, .most = 50ms});  // it may have skipped work
    CHECK(factor.value() == Approx(100));
}

TEST_CASE("EstimateFactor leaves a launch-bound task alone", "[model]") {
    // 25 ms of launching, 10 ms of GPU work in between, 1 ms of it behind the last launch.
    CHECK(after(50, {.most = 25ms, .least = 1ms, .alone = true}) == 1);
}

TEST_CASE("EstimateFactor goes back when a shorter time is not confirmed", "[model]") {
    EstimateFactor factor;
    for (int i = 0; i < 3; ++i) factor.observe({.estimated = 10ms, .most = 5ms});
    REQUIRE(factor.value() == Approx(0.5));
    factor.observe({.estimated = 10ms, .most = 30ms});
    CHECK(factor.value() < 0.52);  // not at once
    for (int i = 0; i < 300; ++i) factor.observe({.estimated = 10ms, .most = 30ms});
    CHECK(factor.value() > 0.95);
    CHECK(factor.value() <= 1);
}

TEST_CASE("EstimateFactor stays within its limits and heeds no empty instance", "[model]") {
    CHECK(after(50, {.most = 1us}) == EstimateFactor::kLeast);
    CHECK(after(50, {.most = 1000s, .least = 1000s, .alone = true}) == EstimateFactor::kMost);
    EstimateFactor factor;
    factor.observe({.estimated = 0ms, .most = 5ms});
    factor.observe({.estimated = 10ms, .most = 0ms});
    CHECK(factor.instances() == 0);
    CHECK_FALSE(factor.is_supported());
    for (int i = 0; i < 3; ++i) factor.observe({.estimated = 10ms, .most = 12ms});
    CHECK(factor.is_supported());
}
