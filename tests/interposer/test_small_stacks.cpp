// SPDX-License-Identifier: Apache-2.0
//
// Threads with little stack.
#include "tests/interposer/check_twin.h"
#include "tests/support/catch.h"

using namespace urgengo::testing;

TEST_CASE("Threads with stacks of 16 KiB do the same when UrgenGo is loaded",
          "[interposer][twins]") {
    check_twin({"small_stacks"});
}

TEST_CASE("UrgenGo starts from a stack of 16 KiB", "[interposer][twins]") {
    check_twin({"small_stacks_first"});
}
