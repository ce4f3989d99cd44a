// SPDX-License-Identifier: Apache-2.0
#include "host/model/urgency.h"

#include "tests/support/catch.h"

using namespace urgengo::model;
using namespace std::chrono_literals;

TEST_CASE("Laxity is what remains of the deadline after all remaining work", "[model][urgency]") {
    // Chain C3 of the paper: D = 120 ms, 30.2 ms of GPU and 20.2 ms of CPU time.
    const Remaining at_arrival{1000ms + 120ms, 30200us, 20200us};
    CHECK(laxity(at_arrival, 1000ms) == 69600us);
    CHECK(laxity(at_arrival, 1070ms) == -400us);
    // Work that proceeds as estimated leaves the laxity as it is.
    CHECK(laxity({1120ms, 30200us, 200us}, 1020ms) == laxity(at_arrival, 1000ms));
}

TEST_CASE("Urgency is the reciprocal of laxity in seconds", "[model][urgency]") {
    // Tab. 2 of the paper prints urgencies per millisecond: C3 has 1/69.6 ms = 0.0143.
    CHECK(urgency_per_s(69600us) == Approx(14.3).epsilon(0.01));
    CHECK(urgency_per_s(-1ms) < 0);
    CHECK(urgency_per_s(0ns) > 0);
}
