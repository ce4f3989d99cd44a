// SPDX-License-Identifier: Apache-2.0
//
// Instances that threads begin and end, by hints and without.
#include "host/runtime/frames.h"

#include "tests/support/runs_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

struct FramesTest : RunsFixture {
    runtime::Frames frames{common(), runs};

    const observe::ChainStatistics& counts() { return common().roster.chains()[0]->statistics; }
};

}  // namespace

TEST_CASE("A hinted frame is the thread's from task_begin to task_end", "[runtime][frames]") {
    FramesTest f;
    CHECK(f.frames.arrival(nullptr, "none", f.clock.now()) == 0);
    const auto token = f.frames.arrival(nullptr, "tight", f.clock.now());
    REQUIRE(token != 0);
    CHECK_FALSE(f.frames.task_begin(f.thread_a, token, "detect"));
    CHECK(runtime::Runs::own_task(f.thread_a) == &f.tight());
    CHECK(f.tight().tracked.arrival == f.clock.now());
    f.clock.advance(21ms);
    f.frames.task_end(f.thread_a);
    CHECK(runtime::Runs::own_task(f.thread_a) == nullptr);
    CHECK(f.counts().frames.instances == 1);
    CHECK(f.counts().frames.missed == 1);
    f.frames.task_end(f.thread_a);  // once
    CHECK(f.counts().frames.instances == 1);
}

TEST_CASE("A frame that nobody told of begins nothing", "[runtime][frames]") {
    FramesTest f;
    CHECK_FALSE(f.frames.task_begin(f.thread_a, 77, "detect"));
    const auto token = f.frames.arrival(nullptr, "tight", f.clock.now());
    CHECK_FALSE(f.frames.task_begin(f.thread_a, token, "track"));
    CHECK(runtime::Runs::own_task(f.thread_a) == nullptr);
    f.common().governor.steered().set(config::Mode::kOff);
    CHECK(f.frames.arrival(nullptr, "tight", f.clock.now()) == 0);
}

TEST_CASE("An instance without hints is its thread's, and costs confidence where it is another one",
          "[runtime][frames]") {
    const bool as_planned = GENERATE(true, false);
    FramesTest f;
    REQUIRE(f.frames.begin(f.thread_a, f.tight(), f.clock.now()));
    CHECK_FALSE(f.frames.begin(f.thread_b, f.tight(), f.clock.now()));
    f.frames.end(f.thread_a, f.clock.now(), as_planned);
    CHECK(f.counts().frames.instances == 1);
    CHECK(f.counts().frames.resyncs == (as_planned ? 0 : 1));
    CHECK(f.tight().known_by.confidence == (as_planned ? 1.0 : 0.875));
    CHECK(f.frames.begin(f.thread_b, f.tight(), f.clock.now()));
}

TEST_CASE("A chain whose frames are told of by hints alone is begun by nothing else",
          "[runtime][frames]") {
    FramesTest f;
    f.common().roster.chains()[0]->config.arrival = config::ArrivalFrom::kHint;
    CHECK_FALSE(f.frames.begin(f.thread_a, f.tight(), f.clock.now()));
}
