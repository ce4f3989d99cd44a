// SPDX-License-Identifier: Apache-2.0
//
// Room for blocks on the simulated SMs.
#include "tests/support/catch.h"
#include "tools/simgpu/engine/sm_array.h"

using urgengo::simgpu::SmArray;

namespace {

std::uint64_t total(const SmArray::Placement& placement) {
    std::uint64_t blocks = 0;
    for (const auto& share : placement) blocks += share.num_blocks;
    return blocks;
}

}  // namespace

TEST_CASE("SmArray places no more blocks than fit when a grid is larger", "[unit][simgpu]") {
    SmArray sms(4);
    CHECK(total(sms.place(1000, 6)) == 24);
    CHECK(sms.place(1, 16).empty());
}

TEST_CASE("SmArray spreads blocks over the SMs when there are few", "[unit][simgpu]") {
    SmArray sms(4);
    const auto placement = sms.place(6, 8);
    REQUIRE(placement.size() == 4);
    CHECK(placement[0].num_blocks == 2);
    CHECK(placement[1].num_blocks == 2);
    CHECK(placement[2].num_blocks == 1);
    CHECK(placement[3].num_blocks == 1);
}

TEST_CASE("SmArray prefers the emptier SM when loads differ", "[unit][simgpu]") {
    SmArray sms(2);
    sms.place(1, 2);  // half of SM 0
    const auto placement = sms.place(2, 4);
    REQUIRE(placement.size() == 1);
    CHECK(placement[0].sm == 1);
}

TEST_CASE("SmArray refuses a block when only pieces of several SMs are free", "[unit][simgpu]") {
    SmArray sms(2);
    sms.place(2, 2);  // half of each
    CHECK(sms.place(1, 1).empty());
}

TEST_CASE("SmArray has all its room again when everything is released", "[unit][simgpu]") {
    SmArray sms(3);
    const auto sevenths = sms.place(10, 7);
    const auto thirteenths = sms.place(100, 13);
    sms.release(sevenths, 7);
    sms.release(thirteenths, 13);
    CHECK(total(sms.place(1000, 16)) == 48);
}
