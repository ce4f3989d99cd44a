// SPDX-License-Identifier: Apache-2.0
//
// Whose launch it is.
#include "host/runtime/resolver.h"

#include "tests/support/runs_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

struct ResolverTest : RunsFixture {
    runtime::Frames frames{common(), runs};
    runtime::WorkOnStreams streams{common(), runs};
    runtime::Resolver resolver{common(), runs, frames, streams};

    /// @returns whose the launch is; nobody is at that task any more
    runtime::TaskState* resolve(ThreadState& thread, CUstream stream = kStreamA) {
        const Launch launch{kConv, 100, 256, stream};
        identity::KnownKernel& kernel =
            common().kernels.find(thread.kernels, thread.tracing.cursor, launch);
        runtime::TaskState* const task =
            resolver.resolve(thread, launch, {kernel.name_hash, 100, 256}, &kernel, clock.now());
        if (task) runs.release(thread);
        return task;
    }
};

}  // namespace

TEST_CASE("A launch is of the task that its thread's hint names", "[runtime][resolver]") {
    ResolverTest f;
    const auto token = f.frames.arrival(nullptr, "loose", f.clock.now());
    f.frames.task_begin(f.thread_a, token, "detect");
    const ThreadName name("th_tight");
    CHECK(f.resolve(f.thread_a) == &f.loose());
    f.frames.task_end(f.thread_a);
    CHECK(f.resolve(f.thread_a) == nullptr);
}

TEST_CASE("A launch is of the task that its thread is named for", "[runtime][resolver]") {
    ResolverTest f;
    const ThreadName name("th_tight");
    CHECK(f.resolve(f.thread_a) == &f.tight());
    CHECK(runtime::Runs::own_task(f.thread_a) == &f.tight());
    CHECK_FALSE(f.thread_a.line.passes);
    CHECK(f.resolver.copying_task(f.thread_a) == &f.tight());
    REQUIRE(f.resolver.take_own(f.thread_a, f.tight()));
    f.resolver.release(f.thread_a);
}

TEST_CASE("A thread of another name launches for the task whose stream it uses, or for nobody",
          "[runtime][resolver]") {
    ResolverTest f;
    {
        const ThreadName name("th_tight");
        f.resolve(f.thread_a);
    }
    ++f.tight().run.position;
    f.tight().tracked.stream = kStreamA;
    const ThreadName name("other");
    const Launch launch{kConv, 100, 256, kStreamB};
    CHECK(f.resolve(f.thread_b, kStreamA) == &f.tight());
    CHECK_FALSE(f.thread_b.line.passes);
    CHECK(f.resolve(f.thread_b, kStreamB) == nullptr);
    CHECK(f.thread_b.line.passes);  // its next ones there need not ask
    CHECK_FALSE(f.resolver.may_be_chains(f.thread_b, launch));
    CHECK(f.resolver.may_be_chains(f.thread_a, launch));
}

TEST_CASE("A launch is of no chain when its run has been ended before it could take the task",
          "[runtime][resolver]") {
    ResolverTest f;
    const ThreadName name("th_tight");
    SECTION("the run that it begins") {
        // As Runs::end_all() leaves it where a thread is at the task, which is about to begin.
        f.tight().taking.end_is_due.store(true);
        CHECK(f.resolve(f.thread_a) == nullptr);
        CHECK(f.tight().taking.owner == nullptr);
        CHECK_FALSE(f.tight().taking.busy);
    }
    CHECK(f.resolve(f.thread_a) == &f.tight());
    CHECK(f.tight().taking.owner == &f.thread_a);
}
