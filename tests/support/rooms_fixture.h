// SPDX-License-Identifier: Apache-2.0
//
// All that a launch or a wait goes through in host/runtime, without Runtime.
#pragma once

#include "host/runtime/launch_path.h"
#include "host/runtime/waits.h"
#include "tests/support/runs_fixture.h"

namespace urgengo::testing {

struct RoomsFixture : RunsFixture {
    using RunsFixture::RunsFixture;
    runtime::Frames frames{common(), runs};
    runtime::WorkOnStreams streams{common(), runs};
    runtime::Resolver resolver{common(), runs, frames, streams};
    runtime::Waits waits{common(), {segments, syncs, runs, frames, streams, resolver}, false};
    runtime::PlannedLaunches planned{common(), segments, runs};
    runtime::Gates gates{common(), segments};
    runtime::LaunchPath launches{
        common(), {segments, syncs, runs, streams, resolver, planned, gates}, 0};

    /// The thread works on a frame of the chain that has just arrived.
    void begin_frame(ThreadState& thread, const char* chain) {
        const auto token = frames.arrival(nullptr, chain, clock.now());
        REQUIRE_FALSE(frames.task_begin(thread, token, "detect"));
    }
    Grant launch_on(ThreadState& thread, CUstream stream, bool succeeds = true) {
        const Launch launch{kConv, 100, 256, stream};
        const Grant grant = launches.before(thread, launch);
        if (grant.task) launches.after(thread, launch, grant, succeeds);
        return grant;
    }
};

}  // namespace urgengo::testing
