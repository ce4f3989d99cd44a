// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/frame_facts.h"

#include <vector>

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using runtime::HoldSpans;

TEST_CASE("Looks of one hold are one span", "[runtime][frame_facts]") {
    HoldSpans holds;
    const auto kept = [&] {
        std::vector<HoldSpans::Hold> all;
        holds.for_each([&](const HoldSpans::Hold& hold) { all.push_back(hold); });
        return all;
    };
    CHECK(kept().empty());
    holds.add({1ms, 10ms, 11ms, 3});
    holds.add({1ms, 11ms, 12ms, 3});
    REQUIRE(kept().size() == 1);
    CHECK(kept()[0].begin == 10ms);
    CHECK(kept()[0].end == 12ms);
    holds.add({1ms, 12ms, 13ms, 4});  // behind another one
    holds.add({1ms, 14ms, 15ms, 4});  // it went in between
    holds.add({2ms, 15ms, 16ms, 4});  // of the next frame
    REQUIRE(kept().size() == 4);
    CHECK(kept()[3].arrival == 2ms);
    CHECK(kept()[3].behind == 4);
    for (int i = 0; i < 1000; ++i) holds.add({3ms, i * 2ms, i * 2ms + 1ms, 5});
    REQUIRE(kept().size() == HoldSpans::kRing);
    CHECK(kept().back().end == 1999ms);
}
