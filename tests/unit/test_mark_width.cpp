// SPDX-License-Identifier: Apache-2.0
#include "host/exec/mark_width.h"

#include "tests/support/catch.h"

using namespace std::chrono_literals;
using urgengo::exec::MarkWidth;

namespace {

constexpr int kSms = 132;
constexpr MarkWidth::Kernel kInTheWay{
    .blocks = 132, .block_threads = 512, .shared_bytes = 0, .time = 1ms};

}  // namespace

TEST_CASE("Marks are wide while long kernels that leave one of a thread no place are about",
          "[exec][marks]") {
    MarkWidth width;
    CHECK(width.threads(1s) == 1);
    width.launches(kInTheWay, kSms, 1s);
    CHECK(width.threads(1s) == 256);
    CHECK(width.threads(10s) == 256);
    CHECK(width.threads(11s) == 1);
    width.launches(kInTheWay, kSms, 12s);
    CHECK(width.threads(12s) == 256);
}

TEST_CASE("Marks have one thread beside all other kernels", "[exec][marks]") {
    MarkWidth::Kernel kernel = kInTheWay;
    int num_sms = kSms;
    SECTION("of fewer threads") {
        kernel.block_threads = 511;
    }
    SECTION("with shared memory") {
        kernel.shared_bytes = 1;
    }
    SECTION("that are short") {
        kernel.time = MarkWidth::kLong - 1ns;
    }
    SECTION("that are not on all multiprocessors") {
        kernel.blocks = 131;
    }
    SECTION("of a GPU of which nothing is known") {
        num_sms = 0;
    }
    MarkWidth width;
    width.launches(kernel, num_sms, 1s);
    CHECK(width.threads(1s) == 1);
}
