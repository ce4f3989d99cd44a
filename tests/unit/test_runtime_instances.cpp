// SPDX-License-Identifier: Apache-2.0
//
// Which instance a launch is of, when nobody says so.
#include "host/observe/nvtx_ranges.h"
#include "tests/support/runtime_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using abi::TraceWait;
using config::Mode;
using runtime::TaskState;

namespace {

const CUfunction kStart = reinterpret_cast<CUfunction>(0x20);
const CUfunction kMore = reinterpret_cast<CUfunction>(0x30);
const CUfunction kLast = reinterpret_cast<CUfunction>(0x40);

// Chain "tight" has a task with two segments: start + more, closed by a wait for the stream; last.
struct Planned : RuntimeFixture {
    Planned() {
        driver.names[kStart] = "start";
        driver.names[kMore] = "more";
        driver.names[kLast] = "last";
        config::TaskProfile& p = resolved.profile->chains[0].tasks[0];
        p.kernels = {{"start", 10, 64, 100us, 0.5},
                     {"more", 10, 64, 100us, 0.5},
                     {"last", 10, 64, 100us, 0.5}};
        p.segments = {{1ms, 2, 2, 2, "stream"}, {1ms, 1, 1, 1, "stream"}};
    }
    Grant launch(ThreadState& thread, CUfunction f, CUstream stream = kStreamA) {
        const Launch l{f, 10, 64, stream};
        const Grant g = rt().launches().before(thread, l);
        if (g.task) rt().launches().after(thread, l, g, true);
        return g;
    }
    void frame(ThreadState& thread) {
        launch(thread, kStart);
        launch(thread, kMore);
        driver.execute_marks(9);
        wait(thread, kStreamA);
        launch(thread, kLast);
        driver.execute_marks(9);
        wait(thread, kStreamA);
    }
};

}  // namespace

TEST_CASE("Runtime follows instances over several waits when the profile knows them",
          "[runtime][instances]") {
    Planned f;
    const ThreadName name("th_tight");
    for (int i = 0; i < 3; ++i) f.frame(f.thread_a);
    CHECK(f.stats(0).frames.instances == 3);
    CHECK(f.stats(0).frames.finished == 3);
    CHECK(f.stats(0).frames.resyncs == 0);
}

TEST_CASE("Runtime counts a resync and goes on when a frame leaves out its end",
          "[runtime][instances]") {
    Planned f;
    const ThreadName name("th_tight");
    f.frame(f.thread_a);
    f.launch(f.thread_a, kStart);
    f.launch(f.thread_a, kMore);
    f.wait(f.thread_a, kStreamA);
    f.frame(f.thread_a);
    CHECK(f.stats(0).frames.instances == 3);
    CHECK(f.stats(0).frames.finished == 3);
    CHECK(f.stats(0).frames.resyncs == 1);
}

TEST_CASE("Runtime only observes a task that does not go as the profile says",
          "[runtime][instances]") {
    Planned f;
    const ThreadName name("th_tight");
    const auto misfit = [&] {
        const bool scheduled = f.launch(f.thread_a, kStart).scheduled;
        f.launch(f.thread_a, kMore);
        f.driver.execute_marks(9);
        f.wait(f.thread_a, kStreamA);
        return scheduled;
    };
    int scheduled = 0;
    for (int i = 0; i < 10; ++i) scheduled += misfit();
    CHECK(scheduled < 6);
    CHECK(scheduled > 1);
    CHECK(f.stats(0).frames.observed > 0);
    for (int i = 0; i < 10; ++i) f.frame(f.thread_a);
    CHECK(f.launch(f.thread_a, kStart).scheduled);  // and trusts it again
}

TEST_CASE("Runtime tells tasks of one thread apart by the kernel that begins them",
          "[runtime][threads]") {
    Planned f;
    f.resolved.config.chains[0].tasks[0].thread_glob = "worker";
    f.resolved.config.chains[1].tasks[0].thread_glob = "worker";
    f.resolved.config.chains[1].tasks[0].kernels = {{"conv", 100, 0}};
    const ThreadName name("worker");
    f.frame(f.thread_a);
    CHECK(f.stats(1).frames.instances == 0);
    const Launch conv{kConv, 100, 256, kStreamA};
    Grant g = f.rt().launches().before(f.thread_a, conv);
    REQUIRE(g.task);
    f.rt().launches().after(f.thread_a, conv, g, true);
    CHECK(f.stats(1).frames.instances == 1);
    f.wait(f.thread_a, kStreamA);
    CHECK(f.stats(1).frames.finished == 1);
    const Launch other_size{kConv, 99, 256, kStreamA};
    CHECK(f.rt().launches().before(f.thread_a, other_size).task == nullptr);
    f.frame(f.thread_a);
    CHECK(f.stats(0).frames.instances == 2);
    CHECK(f.stats(0).frames.resyncs == 0);
}

TEST_CASE("Runtime hands an instance on from task to task when there are no hints",
          "[runtime][instances]") {
    RuntimeFixture f;
    auto& tasks = f.resolved.config.chains[1].tasks;
    tasks = {{"detect", "first"}, {"track", "second"}};
    const std::chrono::nanoseconds begin = f.clock.now();
    {
        const ThreadName name("first");
        f.launch(f.thread_a);
        f.wait(f.thread_a, kStreamA);
        f.clock.advance(30ms);
        f.launch(f.thread_a);  // the next frame
    }
    {
        const ThreadName name("second");
        f.launch(f.thread_b, kStreamB);
        f.clock.advance(10ms);
        f.wait(f.thread_b, kStreamB);
    }
    CHECK(f.stats(1).frames.instances == 2);
    CHECK(f.stats(1).frames.finished == 1);
    CHECK(f.stats(1).frames.latency_max_ns == (f.clock.now() - begin).count());
}

TEST_CASE("Runtime gives a later task the newest frame when those before were skipped",
          "[runtime][instances]") {
    RuntimeFixture f;
    f.resolved.config.chains[1].tasks = {{"detect", "first"}, {"track", "second"}};
    const auto detect = [&] {
        const ThreadName name("first");
        f.launch(f.thread_a);
        f.wait(f.thread_a, kStreamA);
    };
    const auto track = [&] {
        const ThreadName name("second");
        const Grant g = f.launch(f.thread_b, kStreamB);
        REQUIRE(g.task);
        const auto arrival = g.task->tracked.arrival;
        f.wait(f.thread_b, kStreamB);
        return arrival;
    };
    detect();
    track();
    detect();  // nobody takes this one further
    f.clock.advance(30ms);
    track();
    f.clock.advance(30ms);
    detect();
    detect();  // nor the first of these
    const auto newest = f.clock.now();
    f.clock.advance(30ms);
    CHECK(track() <= newest);
    detect();
    const auto next = f.clock.now();
    f.clock.advance(30ms);
    const auto arrival = track();
    CHECK(arrival > next - 1ms);
}

TEST_CASE("Runtime does not end a run for NVTX ranges that no task has", "[runtime][nvtx]") {
    RuntimeFixture f;
    f.resolved.config.chains[0].tasks[0] = {"detect", "", "plan*"};
    const ThreadName name("th_loose");
    f.launch(f.thread_a);
    f.rt().resolver().range_pushed(f.thread_a, "aten::conv2d");
    f.rt().resolver().range_popped(f.thread_a);
    f.launch(f.thread_a);
    CHECK(f.stats(1).frames.instances == 1);
    CHECK(f.stats(1).frames.finished == 0);
}

TEST_CASE("Runtime takes an NVTX range for an instance", "[runtime][nvtx]") {
    RuntimeFixture f;
    f.resolved.config.chains[0].tasks[0] = {"detect", "", "plan*"};
    auto* ranges = observe::make_this_thread_ranges();
    REQUIRE(ranges);
    f.rt();
    const auto frame = [&](const char* range) {
        ranges->push(range);
        f.rt().resolver().range_pushed(f.thread_a, range);
        const bool scheduled = f.launch(f.thread_a).scheduled;
        f.wait(f.thread_a, kStreamA);  // does not end it
        f.launch(f.thread_a);
        ranges->pop();
        f.rt().resolver().range_popped(f.thread_a);
        return scheduled;
    };
    CHECK(frame("plan 1"));
    CHECK(frame("plan 2"));
    CHECK_FALSE(frame("other"));
    CHECK(f.stats(0).frames.instances == 2);
    CHECK(f.stats(0).frames.finished == 2);
    CHECK(f.stats(0).tasks.launches == 4);
}

TEST_CASE("Runtime leaves a chain alone when its arrivals come by hint and none came",
          "[runtime][instances]") {
    RuntimeFixture f;
    f.resolved.config.chains[1].arrival = config::ArrivalFrom::kHint;
    const ThreadName name("th_loose");
    CHECK(f.launch(f.thread_a).task == nullptr);
    CHECK(f.stats(1).frames.instances == 0);
}

TEST_CASE("Runtime ends an instance with a wait for an event behind all of it",
          "[runtime][instances]") {
    RuntimeFixture f;
    const ThreadName name("th_loose");
    const CUevent event = reinterpret_cast<CUevent>(0x77);
    const auto wait_for = [&](CUevent e) {
        runtime::Wait wait;
        wait.function = TraceWait::kEvent;
        wait.event = e;
        f.rt().waits().before(f.thread_a, wait);
        f.rt().waits().after(f.thread_a, wait, true);
    };
    f.launch(f.thread_a);
    f.rt().waits().event_recorded(f.thread_a, event, kStreamA, exec::StreamFlavor::kLegacy, false);
    f.launch(f.thread_a);
    wait_for(event);  // one launch came after it
    CHECK(f.stats(1).frames.finished == 0);
    f.rt().waits().event_recorded(f.thread_a, event, kStreamB, exec::StreamFlavor::kLegacy, false);
    wait_for(event);  // of another stream
    CHECK(f.stats(1).frames.finished == 0);
    f.rt().waits().event_recorded(f.thread_a, event, kStreamA, exec::StreamFlavor::kLegacy, false);
    wait_for(event);
    CHECK(f.stats(1).frames.finished == 1);
}

TEST_CASE("Runtime ends no instance for the time that its launches were held",
          "[runtime][instances]") {
    RuntimeFixture f;
    f.resolved.profile->chains.pop_back();  // nothing is known of `loose`
    f.resolved.config.chains[0].deadline = 10s;
    f.resolved.config.chains[1].period = f.resolved.config.chains[1].deadline = 21ms;
    f.resolved.config.scheduler.policy = config::Policy::kFifo;
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 8; ++i) f.launch(f.thread_a);
    f.clock.on_sleep = [&] {  // its work goes on: it is never overdue
        abi::TaskSlot& slot = *f.thread_a.task->slot;
        slot.progress_ns = slot.launch_ns = slot.look_ns = f.clock.now().count();
    };
    const ThreadName name("th_loose");
    const auto begin = f.clock.now();
    f.launch(f.thread_b, kStreamB);
    CHECK(f.clock.now() - begin > 21ms);
    f.clock.on_sleep = [&] { f.driver.execute_marks(100); };
    f.launch(f.thread_b, kStreamB);
    CHECK(f.stats(1).frames.instances == 1);
    f.clock.advance(22ms);
    f.launch(f.thread_b, kStreamB);  // as if it never waited
    CHECK(f.stats(1).frames.instances == 2);
}
