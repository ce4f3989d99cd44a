// SPDX-License-Identifier: Apache-2.0
//
// Tasks on the GPU and their runs, as the classes above them have them.
#pragma once

#include "host/runtime/runs.h"
#include "tests/support/common_fixture.h"

namespace urgengo::testing {

struct RunsFixture : CommonFixture {
    using CommonFixture::CommonFixture;
    runtime::GpuSegments segments{common()};
    runtime::ImplicitSyncs syncs{common()};
    runtime::Runs runs{common(), segments, syncs};

    void begin_run(ThreadState& thread, runtime::TaskState& task) {
        REQUIRE(runs.claim(thread, task));
        runs.begin(thread, task, clock.now(), clock.now(), true);
    }
};

}  // namespace urgengo::testing
