// SPDX-License-Identifier: Apache-2.0
//
// Causes of frames with more segments and holds than are kept of a task.
#include "tests/support/common_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

TEST_CASE("Frame of more segments than are known keeps what they took longer",
          "[runtime][causes]") {
    RuntimeFixture f;
    f.resolved.config.scheduler.guard = false;
    constexpr int kSegments = 200;
    f.resolved.config.chains[0].deadline = 100ms;
    f.resolved.profile->chains[0].tasks[0] = profile_of("detect", kSegments, 100us, 1.0);
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < kSegments; ++i) {  // the first half of them take ten times as long
        f.launch(f.thread_a);
        const runtime::Wait wait = f.begin_wait(f.thread_a, kStreamA);
        f.clock.advance(i < kSegments / 2 ? 1ms : 100us);
        f.driver.execute_marks(static_cast<int>(f.driver.marks.size()));
        f.rt().waits().after(f.thread_a, wait, true);
    }
    f.rt().frames().task_end(f.thread_a);
    CHECK(f.stats(0).frames.missed == 1);
    const abi::FrameRecord& frame = f.rt().status().chain(0).ring[0];
    CHECK(abi::MissCause{frame.cause.load()} == abi::MissCause::kGpuLonger);
}

TEST_CASE("Frame of more holds than are known was held for all of them", "[runtime][causes]") {
    CommonFixture f;
    runtime::FrameCauses& causes = f.common().observers.causes;
    runtime::TaskState& task = f.tight();
    task.tracked.arrival = 1s;
    causes.run_begins(task, 1s);
    for (int i = 0; i < 300; ++i) {  // 60 ms
        task.run.waited.held += 200us;
        causes.held(task, f.loose().index, 200us, 1s + (i + 1) * 300us);
    }
    causes.run_ends(task, 1120ms);
    const observe::Cause cause =
        causes.frame_ended(*f.common().roster.chains()[0], 1s, 1120ms);  // 100 ms late
    CHECK(cause.kind == abi::MissCause::kHeld);
    CHECK(cause.behind == 1);
    CHECK(cause.amount == 60ms);
}
