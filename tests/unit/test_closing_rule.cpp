// SPDX-License-Identifier: Apache-2.0
#include "host/progress/closing_rule.h"

#include "tests/support/catch.h"

using urgengo::progress::ClosingRule;

TEST_CASE("ClosingRule takes the last stream's wait for the end after two instances left work open",
          "[progress][closing_rule]") {
    ClosingRule rule;
    rule.left_something_open(10);
    CHECK_FALSE(rule.last_stream_ends(1));
    rule.left_something_open(20);  // the first one's was not covered
    CHECK_FALSE(rule.last_stream_ends(1));
    rule.left_something_open(30);
    CHECK(rule.last_stream_ends(1));
    CHECK(rule.last_stream_ends(0));  // without a plan
    rule.left_something_open(40);
    CHECK(rule.last_stream_ends(1));
    rule.all_covered();
    CHECK_FALSE(rule.last_stream_ends(1));
}

TEST_CASE("ClosingRule waits for as many more as an instance has waits",
          "[progress][closing_rule]") {
    ClosingRule rule;
    for (std::uint64_t launched : {1, 2, 3, 4, 5, 6}) rule.left_something_open(launched);
    CHECK_FALSE(rule.last_stream_ends(3));
    rule.left_something_open(7);
    CHECK(rule.last_stream_ends(3));
}

TEST_CASE("ClosingRule counts no wait twice, and none that is covered before the next launch",
          "[progress][closing_rule]") {
    ClosingRule rule;
    for (int query = 0; query < 9; ++query) rule.left_something_open(10);
    CHECK_FALSE(rule.last_stream_ends(1));
    for (std::uint64_t frame = 2; frame < 9; ++frame) {
        rule.left_something_open(10 * frame);
        rule.all_covered();  // the side stream's wait
    }
    CHECK_FALSE(rule.last_stream_ends(1));
}
