// SPDX-License-Identifier: Apache-2.0
//
// Which task a thread's launches are for, in virtual time.
#include "tests/support/runtime_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using runtime::TaskState;
using RuntimeThreadsTest = RuntimeFixture;

TEST_CASE("Runtime takes a thread's launches for the task whose pattern fits its name",
          "[runtime][threads]") {
    RuntimeThreadsTest f;
    char old_name[16] = {};
    prctl(PR_GET_NAME, old_name);
    prctl(PR_SET_NAME, "th_loose");
    CHECK(f.launch(f.thread_a).task != nullptr);
    CHECK(f.stats(1).frames.instances == 1);
    f.wait(f.thread_a, kStreamA);
    CHECK(f.stats(1).frames.finished == 1);
    prctl(PR_SET_NAME, "renamed");  // a pool's thread: read again after each wait
    CHECK(f.launch(f.thread_a).task == nullptr);
    prctl(PR_SET_NAME, old_name);
}

TEST_CASE("Runtime ends an instance that nobody is seen to wait for", "[runtime][threads]") {
    RuntimeThreadsTest f;
    char old_name[16] = {};
    prctl(PR_GET_NAME, old_name);
    prctl(PR_SET_NAME, "th_loose");
    f.launch(f.thread_a);
    f.clock.advance(200ms);
    f.launch(f.thread_a);
    CHECK(f.stats(1).frames.instances == 1);
    f.clock.advance(1ms);
    f.launch(f.thread_a);
    CHECK(f.stats(1).frames.instances == 2);
    CHECK(f.stats(1).frames.finished == 1);
    prctl(PR_SET_NAME, old_name);
}

TEST_CASE("Runtime lets hints take over a thread that its name had matched", "[runtime][threads]") {
    RuntimeThreadsTest f;
    char old_name[16] = {};
    prctl(PR_GET_NAME, old_name);
    prctl(PR_SET_NAME, "th_loose");
    f.launch(f.thread_a);  // a warm-up, never waited for
    f.begin(f.thread_a, "loose");
    CHECK(f.launch(f.thread_a).scheduled);
    f.rt().frames().task_end(f.thread_a);
    CHECK(f.launch(f.thread_a).task == nullptr);
    prctl(PR_SET_NAME, old_name);
}

TEST_CASE("Runtime does not schedule a second thread in a task that is taken",
          "[runtime][threads]") {
    RuntimeThreadsTest f;
    f.begin(f.thread_a, "tight");
    f.begin(f.thread_b, "tight");
    CHECK(f.launch(f.thread_a).task != nullptr);
    CHECK(f.launch(f.thread_b).task == nullptr);
    f.rt().thread_exit(f.thread_a);
    f.rt().frames().task_end(f.thread_b);
    f.begin(f.thread_b, "tight");
    CHECK(f.launch(f.thread_b).task != nullptr);
}

TEST_CASE("Runtime takes a launch for a task by its kernel alone when the config says so",
          "[runtime][threads]") {
    RuntimeFixture f;
    f.resolved.config.chains[0].tasks[0].thread_glob = "";
    f.resolved.config.chains[0].tasks[0].kernels = {{"co*", 0, 0}};
    CHECK(f.launch(f.thread_a).task != nullptr);
    CHECK(f.stats(0).frames.instances == 1);
}

TEST_CASE("Runtime takes a helper thread for the task whose stream it launches on",
          "[runtime][threads]") {
    RuntimeFixture f;
    {
        const ThreadName name("th_loose");
        f.launch(f.thread_a);
    }
    CHECK(f.launch(f.thread_b, kStreamB).task == nullptr);
    f.wait(f.thread_b, kStreamB);
    const Grant g = f.launch(f.thread_b, kStreamA);
    REQUIRE(g.task);
    CHECK(g.task->name() == "detect");
    CHECK(f.stats(1).tasks.launches == 2);
    CHECK(f.stats(1).frames.instances == 1);
    f.rt().work_on_streams().destroyed(kStreamA);
    f.wait(f.thread_b, kStreamA);
    CHECK(f.launch(f.thread_b, kStreamA).task == nullptr);
}

TEST_CASE("Runtime lets a thread launch for an instance that another one has begun by hint",
          "[runtime][threads]") {
    RuntimeFixture f;
    f.begin(f.thread_a, "loose");  // the middleware's thread
    const ThreadName name("th_loose");
    CHECK(f.launch(f.thread_b, kStreamB).task != nullptr);
    CHECK(f.launch(f.thread_b, kStreamB).task != nullptr);
    f.rt().frames().task_end(f.thread_a);
    CHECK(f.stats(1).frames.instances == 1);
    CHECK(f.stats(1).frames.finished == 1);
    CHECK(f.stats(1).tasks.launches == 2);
}

TEST_CASE("Runtime ends a run while a helper is held in it, and schedules the next one",
          "[runtime][threads]") {
    RuntimeFixture f;
    f.begin(f.thread_b, "tight");
    f.launch(f.thread_b, kStreamB);
    f.begin_wait(f.thread_b, kStreamB);
    f.clock.advance(1ms);
    f.begin(f.thread_a, "loose");
    ThreadState helper;
    const ThreadName name("th_loose");
    f.clock.on_sleep = [&] {
        if (f.clock.num_sleeps == 1) f.rt().frames().task_end(f.thread_a);
        if (f.clock.num_sleeps == 3) f.driver.execute_marks(9);
    };
    CHECK(f.launch(helper, kStreamA).task != nullptr);
    f.clock.on_sleep = nullptr;
    f.begin(f.thread_a, "loose");
    CHECK(f.launch(f.thread_a).scheduled);
}

TEST_CASE("Runtime gives a task to another thread when the first one has left its run lying",
          "[runtime][threads]") {
    RuntimeFixture f;
    const ThreadName name("th_loose");
    f.launch(f.thread_a);  // a warm-up; period 200 ms
    f.clock.advance(1500ms);
    CHECK(f.launch(f.thread_b, kStreamB).task == nullptr);
    f.clock.advance(200ms);
    CHECK(f.launch(f.thread_b, kStreamB).task != nullptr);
    f.wait(f.thread_a, kStreamA);  // it ends nothing of the other's
    CHECK(f.launch(f.thread_b, kStreamB).task != nullptr);
    f.rt().thread_exit(f.thread_a);
    CHECK(f.launch(f.thread_b, kStreamB).task != nullptr);
    CHECK(f.stats(1).frames.finished == 0);
}

TEST_CASE("Runtime does not let a helper pass because its task was busy", "[runtime][threads]") {
    RuntimeFixture f;
    ThreadState helper;
    {
        const ThreadName name("th_loose");
        f.launch(f.thread_a);
    }
    TaskState* const task = f.thread_a.task;
    task->taking.busy = true;  // the owner is held
    CHECK(f.launch(helper, kStreamA).task == nullptr);
    CHECK_FALSE(helper.line.passes);
    task->taking.busy = false;
    CHECK(f.launch(helper, kStreamA).task != nullptr);
}

TEST_CASE("Runtime passes calls of a thread that is nobody's until its name may have changed",
          "[runtime][threads]") {
    RuntimeFixture f;
    ThreadState& t = f.thread_a;
    CHECK(f.launch(t).task == nullptr);
    CHECK(t.line.passes);
    CHECK(t.line.passes_stream == kStreamA);
    // As the wrappers do: the first wait ends it.
    CHECK(t.line.waits_to_pass == 1);
    t.line.passes = t.serves.name_is_fresh = false;
    t.line.waits_to_pass = 0;
    const ThreadName name("th_loose");
    CHECK(f.launch(t).task != nullptr);
    CHECK_FALSE(t.line.passes);
}

TEST_CASE("Runtime passes waits of a thread that never launches but not its first launch",
          "[runtime][threads]") {
    RuntimeFixture f;
    f.wait(f.thread_a, kStreamA);
    CHECK(f.thread_a.line.passes);
    CHECK(f.thread_a.line.passes_stream != kStreamA);
    CHECK(f.thread_a.line.passes_stream != nullptr);
    const ThreadName name("th_loose");
    f.wait(f.thread_b, kStreamB);
    CHECK_FALSE(f.thread_b.line.passes);
    CHECK(f.launch(f.thread_b, kStreamB).task != nullptr);
}

TEST_CASE("Runtime says which tasks nothing matched and which threads it saw", "[runtime]") {
    RuntimeFixture f;
    CHECK(f.rt().report().warnings().empty());  // nothing was launched at all
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    const ThreadName name("stranger");
    f.launch(f.thread_b);
    const auto lines = f.rt().report().warnings();
    REQUIRE(lines.size() == 1);
    CHECK(lines[0] ==
          "warning: nothing matched task 'detect' of chain 'loose' (thread: 'th_loose'); threads "
          "that launched and matched nothing: 'stranger'");
}

TEST_CASE("Runtime finds a thread again that takes its task's name for every second frame",
          "[runtime][instances]") {
    RuntimeFixture f;
    ThreadState& t = f.thread_a;
    for (int frame = 0; frame < 10; ++frame) {
        const ThreadName name(frame % 2 == 0 ? "worker" : "th_tight");
        // As the interposer does it.
        if (!t.line.passes || t.line.passes_stream != kStreamA)
            for (int i = 0; i < 20; ++i) f.launch(t);
        if (!t.line.passes)
            f.wait(t, kStreamA);
        else if (--t.line.waits_to_pass == 0)
            t.line.passes = t.serves.name_is_fresh = false;
    }
    CHECK(f.stats(0).frames.instances == 5);
}
