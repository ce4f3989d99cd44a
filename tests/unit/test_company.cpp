// SPDX-License-Identifier: Apache-2.0
#include "host/sched/company.h"

#include <memory>

#include "tests/support/catch.h"
#include "tests/support/lidar_and_camera.h"

using namespace urgengo;
using namespace std::chrono_literals;
using sched::Company;

namespace {

std::vector<config::Chain> with_periods(std::chrono::nanoseconds period) {
    auto chains = testing::lidar_and_camera(80ms, 80ms, {{"detect", ""}}).chains;
    for (config::Chain& chain : chains) chain.period = period;
    return chains;
}

}  // namespace

TEST_CASE("Task is solitary after two periods of each chain, as they are now", "[sched][company]") {
    const auto page = std::make_unique<abi::SharedPage>();
    Company company(*page, with_periods(5s), 0s);
    CHECK_FALSE(company.is_solitary(9s));
    CHECK(company.is_solitary(11s));
    company.describe(with_periods(1s));
    CHECK_FALSE(company.is_solitary(1900ms));
    CHECK(company.is_solitary(2100ms));
    company.describe(with_periods(10s));
    CHECK_FALSE(company.is_solitary(11s));
}
