// SPDX-License-Identifier: Apache-2.0
//
// The program's waits, without the rest of the runtime.
#include "host/runtime/waits.h"

#include "tests/support/rooms_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

const CUevent kEvent = reinterpret_cast<CUevent>(0xe);

/// Thread a has launched for its frame.
struct WaitsTest : RoomsFixture {
    WaitsTest() {
        begin_frame(thread_a, "tight");
        launch_on(thread_a, kStreamA);
    }
    runtime::Wait begin(CUstream stream, CUevent event = nullptr) {
        runtime::Wait wait;
        wait.function = event ? abi::TraceWait::kEvent : abi::TraceWait::kStream;
        wait.stream = stream;
        wait.event = event;
        waits.before(thread_a, wait);
        return wait;
    }
};

}  // namespace

TEST_CASE("A wait for all that the task has launched ends its GPU segment", "[runtime][waits]") {
    const bool succeeds = GENERATE(true, false);
    WaitsTest f;
    const runtime::Wait wait = f.begin(kStreamA);
    CHECK(wait.for_all);
    CHECK(f.tight().slot->waits == 1);
    f.waits.after(f.thread_a, wait, succeeds);
    CHECK(f.tight().slot->waits == 0);
    CHECK(f.tight().run.on_gpu == !succeeds);
}

TEST_CASE("A wait for another stream ends nothing", "[runtime][waits]") {
    WaitsTest f;
    const runtime::Wait wait = f.begin(kStreamB);
    CHECK_FALSE(wait.for_all);
    f.waits.after(f.thread_a, wait, true);
    CHECK(f.tight().run.on_gpu);
}

TEST_CASE("A wait for the event behind all is one for all", "[runtime][waits]") {
    WaitsTest f;
    f.waits.event_recorded(f.thread_a, kEvent, kStreamA, exec::StreamFlavor::kLegacy, false);
    CHECK(f.begin(nullptr, kEvent).for_all);
    f.launch_on(f.thread_a, kStreamA);
    CHECK_FALSE(f.begin(nullptr, kEvent).for_all);
}

TEST_CASE("Behind an event that takes the time a launch may be timed", "[runtime][waits]") {
    WaitsTest f;
    f.waits.event_recorded(f.thread_a, kEvent, kStreamA, exec::StreamFlavor::kLegacy, true);
    CHECK(f.thread_a.measuring);
    CHECK(f.thread_a.line.as_planned.left == 0);
    CHECK(f.launch_on(f.thread_a, kStreamA).may_be_timed);
    CHECK_FALSE(f.thread_a.measuring);
}

TEST_CASE("A call that waits for everything is told of by its begin and end", "[runtime][waits]") {
    WaitsTest f;
    f.waits.implicit_sync_begins(f.thread_a);
    CHECK(f.tight().slot->state == abi::TaskState::kSync);
    f.waits.implicit_sync_ended(f.thread_a);
    CHECK(f.tight().slot->state == abi::TaskState::kGpu);
    f.waits.implicit_sync_begins(f.thread_b);  // of no task
    f.waits.implicit_sync_ended(f.thread_b);
}
