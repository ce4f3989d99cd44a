// SPDX-License-Identifier: Apache-2.0
#include "host/sched/bandwidth.h"

#include "tests/support/catch.h"
#include "tests/support/runtime_fixture.h"

namespace urgengo::testing {
namespace {

using sched::Bandwidth;
using std::chrono::nanoseconds;

}  // namespace

TEST_CASE("A frame that comes early is put off until it is due", "[sched][bandwidth]") {
    Bandwidth b;
    const nanoseconds start = 10s;
    CHECK(b.arrived(start, 100ms) == 0ms);
    CHECK(b.served(start) == start);
    // Due at 87.5 ms; half a period early is not early.
    CHECK(b.arrived(start + 10ms, 100ms) == 27'500us);
    CHECK(b.served(start + 10ms) == start + 37'500us);
    CHECK(b.served(start) == start);
    CHECK(b.arrived(start + 20ms, 100ms) == 105ms);
    CHECK(b.arrived(start + 30ms, 100ms) == 182'500us);
    CHECK(b.arrived(start + 40ms, 100ms) == 200ms);  // no more than two periods
    CHECK(b.arrived(start + 50ms, 100ms) == 200ms);
    CHECK(b.served(start + 1s) == start + 1s);  // not known
    CHECK(b.arrived(start + 2s, 100ms) == 0ms);
}

TEST_CASE("Frames that jitter, or come an eighth more often, are not early", "[sched][bandwidth]") {
    Bandwidth b;
    for (int i = 0; i < 1000; ++i)
        CHECK(b.arrived(10s + i * 88ms + (i * 7919 % 40) * 1ms, 100ms) == 0ms);
}

TEST_CASE("Runtime orders an early frame by when it was due, and counts its misses by its arrival",
          "[runtime][instances]") {
    RuntimeFixture f;  // a period of 200 ms, a deadline of 20 ms
    const auto frame = [&] {
        const nanoseconds arrival = f.clock.now();
        f.begin(f.thread_a, "tight");
        const nanoseconds deadline(f.launch(f.thread_a).task->slot->deadline_ns);
        f.clock.advance(30ms);
        f.rt().frames().task_end(f.thread_a);
        return deadline - arrival;
    };
    CHECK(frame() == 20ms);
    CHECK(frame() == 20ms + 45ms);  // due at 175 ms, half a period may be missing
    CHECK(f.stats(0).frames.missed == 2);
    CHECK(f.stats(0).frames.early == 1);
}

}  // namespace urgengo::testing
