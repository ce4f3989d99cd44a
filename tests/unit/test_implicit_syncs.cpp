// SPDX-License-Identifier: Apache-2.0
//
// Tasks whose threads wait for all work of the context.
#include "host/runtime/implicit_syncs.h"

#include "host/runtime/gpu_segments.h"
#include "tests/support/common_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

/// Work of the chain `loose` is on the GPU, and `tight` is on the CPU.
struct ImplicitSyncsTest : CommonFixture {
    runtime::GpuSegments segments{common()};
    runtime::ImplicitSyncs syncs{common()};

    ImplicitSyncsTest() {
        loose().slot->version = 2;
        tight().slot->state = abi::TaskState::kCpu;
        REQUIRE(segments.enter(loose(), clock.now()));
    }
    void launch_loose() {
        loose().work.launched += 100us;
        loose().slot->launched_ns = loose().work.launched.count();
        loose().slot->started = 1;
    }
};

}  // namespace

TEST_CASE("A task needs the whole GPU while it waits for all that is there",
          "[runtime][implicit_syncs]") {
    ImplicitSyncsTest f;
    f.launch_loose();
    REQUIRE(f.syncs.enter(f.tight()));
    CHECK(f.tight().slot->state == abi::TaskState::kSync);
    // Twice what is under way, and a millisecond.
    CHECK(f.tight().slot->sync_until_ns == (f.clock.now() + 1200us).count());
    CHECK(f.common().page().on_gpu == 2);
    CHECK_FALSE(f.syncs.enter(f.tight()));  // it does already
    f.syncs.leave(f.tight());
    CHECK(f.tight().slot->state == abi::TaskState::kCpu);
    CHECK(f.common().page().on_gpu == 1);
}

TEST_CASE("A task needs nothing where there is nothing to wait for", "[runtime][implicit_syncs]") {
    ImplicitSyncsTest f;
    CHECK_FALSE(f.syncs.enter(f.tight()));
    CHECK(f.tight().slot->state == abi::TaskState::kCpu);
    f.launch_loose();
    f.tight().run.observed = true;
    CHECK_FALSE(f.syncs.enter(f.tight()));
}

TEST_CASE("A kernel's first launch waits once, until the task is let go",
          "[runtime][implicit_syncs]") {
    ImplicitSyncsTest f;
    f.launch_loose();
    identity::KnownKernel kernel;
    kernel.is_new = true;
    f.syncs.first_launch_begins(f.tight(), kernel);
    CHECK_FALSE(kernel.is_new);
    CHECK(f.tight().slot->state == abi::TaskState::kSync);
    CHECK(f.tight().taking.sync_end_is_due);
}
