// SPDX-License-Identifier: Apache-2.0
//
// What the runtime does at calls other than plain launches: events that measure, graphs, waits, and
// calls that wait for everything.
#include "tests/support/runtime_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

const CUevent kEvent = reinterpret_cast<CUevent>(0x77);
const CUgraph kGraph = reinterpret_cast<CUgraph>(0x99);
const CUgraphExec kExecutable = reinterpret_cast<CUgraphExec>(0x9a);

void record(RuntimeFixture& f, ThreadState& thread, bool timed, CUstream stream = kStreamA) {
    f.rt().waits().event_recorded(thread, kEvent, stream, exec::StreamFlavor::kLegacy, timed);
}

/// The tight task has the whole GPU: 20 kernels of 100 us, none of them done.
void keep_busy(RuntimeFixture& f) {
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 3; ++i) f.launch(f.thread_a);
}

Grant launch_asking(RuntimeFixture& f, int priority) {
    Launch launch{kConv, 100, 256, kStreamB};
    launch.asks_priority = true;
    launch.priority = priority;
    const Grant grant = f.rt().launches().before(f.thread_b, launch);
    f.rt().launches().after(f.thread_b, launch, grant, true);
    return grant;
}

/// Of the driver, at a launch of the loose task's.
bool asks_about_captures(RuntimeFixture& f) {
    const int before = f.driver.num_capture_queries;
    f.launch(f.thread_b, kStreamB);
    return f.driver.num_capture_queries > before;
}

}  // namespace

TEST_CASE("Runtime puts neither mark nor hold around a launch when a timing event is before it",
          "[runtime][events]") {
    RuntimeFixture f;
    keep_busy(f);
    f.begin(f.thread_b, "loose");
    f.driver.marks.clear();
    for (int i = 0; i < 4; ++i) {  // event, kernel, event: as autotuners do
        record(f, f.thread_b, true, kStreamB);
        const std::size_t marks_before = f.driver.marks.size();
        f.launch(f.thread_b, kStreamB);
        CHECK(f.driver.marks.size() == marks_before);
        record(f, f.thread_b, true, kStreamB);
        CHECK(f.driver.marks.size() == marks_before);
    }
    CHECK(f.clock.num_sleeps == 0);
    // What is due goes before the next launch that nobody times.
    const std::size_t marks_before = f.driver.marks.size();
    record(f, f.thread_b, false, kStreamB);
    f.clock.on_sleep = [&] { f.driver.execute_marks(100); };
    f.launch(f.thread_b, kStreamB);
    CHECK(f.driver.marks.size() + static_cast<std::size_t>(f.clock.num_sleeps) > marks_before);
}

TEST_CASE("Runtime holds a launch when an event without timing is before it", "[runtime][events]") {
    RuntimeFixture f;
    keep_busy(f);
    f.begin(f.thread_b, "loose");
    f.clock.on_sleep = [&] { f.driver.execute_marks(100); };
    record(f, f.thread_b, false, kStreamB);
    f.launch(f.thread_b, kStreamB);
    CHECK(f.clock.num_sleeps > 0);
}

TEST_CASE("Runtime holds the second launch behind a timing event", "[runtime][events]") {
    RuntimeFixture f;
    keep_busy(f);
    f.begin(f.thread_b, "loose");
    record(f, f.thread_b, true, kStreamB);
    f.launch(f.thread_b, kStreamB);
    CHECK(f.clock.num_sleeps == 0);
    f.clock.on_sleep = [&] { f.clock.advance(1ms); };
    f.launch(f.thread_b, kStreamB);  // who times a whole inference is scheduled as ever
    CHECK(f.clock.num_sleeps > 0);
}

TEST_CASE("Runtime takes the program's own priority for a wish of one level",
          "[runtime][priority]") {
    RuntimeFixture f(0.1);  // fits beside
    keep_busy(f);
    f.begin(f.thread_b, "loose");
    CHECK(f.launch(f.thread_b, kStreamB).priority == -4);  // the second of two
    CHECK(launch_asking(f, -1).priority == -5);
    CHECK(launch_asking(f, -5).priority == -5);
    CHECK(launch_asking(f, 0).priority == -4);
    f.driver.own_priority = -3;  // of every stream
    CHECK(f.launch(f.thread_b, reinterpret_cast<CUstream>(0xc0)).priority == -5);
    CHECK(f.launch(f.thread_b, nullptr).priority == -4);
}

TEST_CASE("Runtime knows a graph by what is in it", "[runtime][graphs]") {
    RuntimeFixture f;
    f.driver.names[reinterpret_cast<CUfunction>(0x20)] = "gemm";
    f.driver.nodes = {{kConv, 100, 256}, {reinterpret_cast<CUfunction>(0x20), 5, 128}};
    // What the profile says of it, under the name that depends on nothing but that.
    auto& kernels = f.resolved.profile->chains[0].tasks[0].kernels;
    kernels.assign(1, {"(graph of 2 kernels, 9170ac53)", 1, 1, 5ms, 0.5});
    f.rt().graph_instantiated(kExecutable, kGraph);
    f.begin(f.thread_a, "tight");
    Launch launch{nullptr, 1, 1, kStreamA};
    launch.graph = kExecutable;
    const Grant known = f.rt().launches().before(f.thread_a, launch);
    CHECK(known.estimate == 5ms);
    f.rt().launches().after(f.thread_a, launch, known, true);
    f.rt().kernels().graph_destroyed(kExecutable);
    f.driver.nodes.resize(1);
    f.rt().graph_instantiated(kExecutable, kGraph);  // another one, at the same handle
    f.wait_a();
    f.rt().frames().task_end(f.thread_a);
    f.begin(f.thread_a, "tight");
    const Grant unknown = f.rt().launches().before(f.thread_a, launch);
    CHECK(unknown.estimate == 1ms);
    f.rt().launches().after(f.thread_a, launch, unknown, true);
}

TEST_CASE("Runtime looks into graphs only when the profile knows some", "[runtime][graphs]") {
    RuntimeFixture f;
    const bool knows = GENERATE(false, true);
    if (knows) f.resolved.profile->chains[1].tasks[0].kernels[3].name = "(graph of 2 kernels, 1)";
    f.driver.nodes = {{kConv, 100, 256}};
    f.rt().graph_instantiated(kExecutable, kGraph);
    CHECK((f.driver.num_graph_queries > 0) == knows);
    f.begin(f.thread_a, "tight");
    Launch launch{nullptr, 1, 1, kStreamA};
    launch.graph = kExecutable;
    const Grant grant = f.rt().launches().before(f.thread_a, launch);
    CHECK(grant.estimate == 1ms);  // unknown either way
    f.rt().launches().after(f.thread_a, launch, grant, true);
    CHECK(f.stats(0).tasks.unknown == 1);
}

TEST_CASE("Runtime sleeps through a wait if asked to, and asks the driver seldom",
          "[runtime][waits]") {
    RuntimeFixture f;
    f.resolved.config.blocking_sync = true;
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 20; ++i) f.launch(f.thread_a);  // 2 ms
    const auto end = f.clock.now() + 2ms;
    f.driver.is_over = [&] { return f.clock.now() >= end; };
    const runtime::Wait wait = f.begin_wait(f.thread_a, kStreamA);
    f.rt().waits().sleep_through(f.thread_a, wait);
    CHECK(f.clock.now() >= end);
    CHECK(f.clock.now() < end + 250us);
    CHECK(f.driver.num_queries < 60);
}

TEST_CASE("Runtime does not sleep for long when a task alone may be further than its marks say",
          "[runtime][waits]") {
    RuntimeFixture f;
    f.resolved.config.blocking_sync = true;
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 10; ++i) f.launch(f.thread_a);
    const auto begin = f.clock.now();
    f.driver.is_over = [&] { return f.clock.now() > begin; };
    f.rt().waits().sleep_through(f.thread_a, f.begin_wait(f.thread_a, kStreamA));
    CHECK(f.clock.now() <= begin + 150us);
}

TEST_CASE("Runtime does not put the program's wait off for long when the stream is never idle",
          "[runtime][waits]") {
    RuntimeFixture f;
    f.resolved.config.blocking_sync = true;
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 20; ++i) f.launch(f.thread_a);  // 2 ms
    f.driver.is_over = [] { return false; };
    const auto begin = f.clock.now();
    f.rt().waits().sleep_through(f.thread_a, f.begin_wait(f.thread_a, kStreamA));
    CHECK(f.clock.now() > begin + 4ms);
    CHECK(f.clock.now() < begin + 11ms);
}

TEST_CASE("Runtime does not pace a task alone for what it left on another stream",
          "[runtime][hold]") {
    RuntimeFixture f;
    f.begin(f.thread_a, "tight");
    f.clock.on_sleep = [&] { f.clock.advance(50us); };
    for (int i = 0; i < 20; ++i) {
        f.launch(f.thread_a, i % 2 == 0 ? kStreamA : kStreamB);
        f.driver.execute_marks(100);  // the GPU keeps up
    }
    CHECK(f.clock.num_sleeps == 0);
    CHECK(f.stats(0).tasks.marks == 4);  // neither stream vouches for the other: each for itself
    f.wait(f.thread_a, kStreamA);
    f.wait(f.thread_a, kStreamB);
    for (int i = 0; i < 20; ++i) {
        f.launch(f.thread_a, i < 10 ? kStreamA : kStreamB);
        f.driver.execute_marks(100);
    }
    CHECK(f.clock.num_sleeps == 0);
    CHECK_FALSE(f.stats(0).tasks.marks == 0);
}

TEST_CASE("Runtime leaves waits alone when nobody asked or a capture is under way",
          "[runtime][waits]") {
    RuntimeFixture f;
    f.resolved.config.blocking_sync = GENERATE(false, true);
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    if (f.resolved.config.blocking_sync)
        f.rt().streams().capture_begins(kStreamB, exec::StreamFlavor::kLegacy);
    f.driver.is_over = [] { return false; };
    f.rt().waits().sleep_through(f.thread_a, f.begin_wait(f.thread_a, kStreamA));
    CHECK(f.driver.num_queries == 0);
    CHECK(f.clock.num_sleeps == 0);
}

TEST_CASE("Runtime knows that a capture is over when the stream that it began on is destroyed",
          "[runtime][capture]") {
    RuntimeFixture f;
    const auto flavor = exec::StreamFlavor::kLegacy;
    f.driver.capturing = kStreamA;
    f.begin(f.thread_b, "loose");
    f.rt().streams().capture_begins(kStreamA, flavor);
    CHECK_FALSE(f.rt().work_on_streams().destroyed(kStreamB));  // at most a part of that capture
    CHECK(asks_about_captures(f));
    REQUIRE(f.rt().work_on_streams().destroyed(kStreamA));
    f.rt().streams().capture_ended(kStreamA, flavor);
    CHECK_FALSE(asks_about_captures(f));
    // The handle is another stream's now.
    CHECK_FALSE(f.rt().work_on_streams().destroyed(kStreamA));
}

TEST_CASE("Runtime knows that a capture goes on when another one is refused or has ended",
          "[runtime][capture]") {
    RuntimeFixture f;
    const auto flavor = exec::StreamFlavor::kLegacy;
    f.begin(f.thread_b, "loose");
    f.rt().streams().capture_begins(kStreamA, flavor);
    f.rt().streams().capture_begins(kStreamA, flavor);  // refused
    f.rt().streams().capture_ended(kStreamA, flavor);
    f.rt().streams().capture_ended(kStreamB, flavor);  // began before anybody looked
    CHECK(asks_about_captures(f));
    f.rt().streams().capture_ended(kStreamA, flavor);
    CHECK_FALSE(asks_about_captures(f));
}

TEST_CASE("Runtime knows that a capture whose begin may have been refused is over with its stream",
          "[runtime][capture]") {
    RuntimeFixture f;
    const auto flavor = exec::StreamFlavor::kLegacy;
    f.begin(f.thread_b, "loose");
    for (int i = 0; i < 3; ++i) f.rt().streams().capture_may_begin(kStreamA, flavor);
    CHECK(asks_about_captures(f));
    REQUIRE(f.rt().work_on_streams().destroyed(kStreamA));
    f.rt().streams().capture_ended(kStreamA, flavor);
    CHECK_FALSE(asks_about_captures(f));
}

TEST_CASE("Runtime lets less urgent tasks add nothing while one waits for all GPU work",
          "[runtime][implicit_sync]") {
    RuntimeFixture f(0.1);  // everything would fit beside everything
    f.begin(f.thread_b, "loose");
    for (int i = 0; i < 5; ++i) f.launch(f.thread_b, kStreamB);  // 500 us under way
    f.begin(f.thread_a, "tight");
    f.rt().waits().implicit_sync_begins(f.thread_a);
    const auto begin = f.clock.now();
    int num_sleeps = 0;
    f.clock.on_sleep = [&] {
        if (++num_sleeps == 4) f.rt().waits().implicit_sync_ended(f.thread_a);
    };
    f.launch(f.thread_b, kStreamB);
    CHECK(num_sleeps == 4);
    CHECK(f.clock.now() < begin + 1ms);

    // Not for ever: what it waits for may be the launch that is held.
    f.rt().waits().implicit_sync_begins(f.thread_a);
    f.clock.on_sleep = nullptr;
    const auto again = f.clock.now();
    f.launch(f.thread_b, kStreamB);
    CHECK(f.clock.now() > again + 1ms);
    CHECK(f.clock.now() < again + 4ms);
    f.rt().waits().implicit_sync_ended(f.thread_a);
    CHECK(f.stats(0).tasks.implicit_syncs == 2);
}

TEST_CASE("Runtime holds nobody for a wait for all GPU work when there is none",
          "[runtime][implicit_sync]") {
    RuntimeFixture f;
    f.begin(f.thread_b, "loose");
    f.begin(f.thread_a, "tight");
    f.rt().waits().implicit_sync_begins(f.thread_a);
    f.launch(f.thread_b, kStreamB);
    CHECK(f.clock.num_sleeps == 0);
    f.rt().waits().implicit_sync_ended(f.thread_a);
    CHECK(f.stats(0).tasks.implicit_syncs == 0);
}

TEST_CASE("Runtime lets less urgent tasks add nothing while a kernel's first launch may load it",
          "[runtime][implicit_sync]") {
    RuntimeFixture f(0.1);
    const auto other = reinterpret_cast<CUfunction>(0x20);
    f.driver.names[other] = "gemm";
    f.begin(f.thread_b, "loose");
    for (int i = 0; i < 5; ++i) f.launch(f.thread_b, kStreamB);
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);  // thread b has launched this one before
    CHECK(f.stats(0).tasks.implicit_syncs == 0);

    const Launch launch{other, 1, 32, kStreamA};  // small: others fit beside it
    const Grant grant = f.rt().launches().before(f.thread_a, launch);
    const auto begin = f.clock.now();
    int num_sleeps = 0;
    f.clock.on_sleep = [&] {
        if (++num_sleeps == 4) f.rt().launches().after(f.thread_a, launch, grant, true);
    };
    f.launch(f.thread_b, kStreamB);
    CHECK(num_sleeps == 4);
    CHECK(f.clock.now() < begin + 1ms);
    CHECK(f.stats(0).tasks.implicit_syncs == 1);

    // It is there now; and for other threads, too.
    f.clock.on_sleep = nullptr;
    f.rt().launches().after(f.thread_a, launch, f.rt().launches().before(f.thread_a, launch), true);
    CHECK(f.stats(0).tasks.implicit_syncs == 1);
    ThreadState helper;
    f.rt().launches().after(helper, launch, f.rt().launches().before(helper, launch), true);
    CHECK(f.stats(0).tasks.launches == 4);
    CHECK(f.stats(0).tasks.implicit_syncs == 1);

    SECTION("not for ever") {
        const Launch third{reinterpret_cast<CUfunction>(0x30), 1, 32, kStreamA};
        const Grant waits = f.rt().launches().before(f.thread_a, third);
        const auto again = f.clock.now();
        f.launch(f.thread_b, kStreamB);
        CHECK(f.clock.now() > again + 1ms);
        CHECK(f.clock.now() < again + 4ms);
        f.rt().launches().after(f.thread_a, third, waits, true);
    }
    SECTION("again when modules were unloaded") {
        f.rt().contexts().forget_names();
        f.rt().launches().after(f.thread_a, launch, f.rt().launches().before(f.thread_a, launch),
                                true);
        CHECK(f.stats(0).tasks.implicit_syncs == 2);
    }
}

TEST_CASE("Runtime keeps a wait for all GPU work apart from a helper's launches meanwhile",
          "[runtime][implicit_sync]") {
    RuntimeFixture f(0.1);
    ThreadState helper;
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    f.begin(f.thread_b, "loose");
    for (int i = 0; i < 5; ++i) f.launch(f.thread_b, kStreamB);
    const bool is_held = GENERATE(false, true);
    if (!is_held) {  // the helper's launch is the task's first
        f.wait(f.thread_a, kStreamA);
        f.rt().frames().task_end(f.thread_a);
        f.begin(f.thread_a, "tight");
    }
    f.rt().waits().implicit_sync_begins(f.thread_a);
    f.clock.on_sleep = [&] { f.driver.execute_marks(100); };
    for (int i = 0; i < (is_held ? 12 : 1); ++i) f.launch(helper);
    CHECK((f.clock.num_sleeps > 0) == is_held);  // it is paced

    int num_sleeps = 0;
    f.clock.on_sleep = [&] {
        if (++num_sleeps == 4) f.rt().waits().implicit_sync_ended(f.thread_a);
    };
    f.launch(f.thread_b, kStreamB);
    CHECK(num_sleeps == 4);
    f.launch(f.thread_b, kStreamB);
    CHECK(num_sleeps == 4);
    CHECK(f.stats(0).tasks.launches == (is_held ? 13 : 2));
}
