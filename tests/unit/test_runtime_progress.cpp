// SPDX-License-Identifier: Apache-2.0
//
// What the runtime tells of where the GPU is, in virtual time.
#include "tests/support/runtime_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using Fixture = RuntimeFixture;
using model::kernel_id;

namespace {

/// `tight`, which somebody looks at: marked every two kernels of 100 us.
struct Watched : RuntimeFixture {
    Watched() {
        begin(thread_b, "loose");
        launch(thread_b, kStreamB);
        begin(thread_a, "tight");
    }
    void launch_a(int launches) {
        for (int i = 0; i < launches; ++i) launch(thread_a);
    }
    /// The GPU, whose clock is 4 s ahead, reaches so many marks now.
    void execute(std::size_t marks) {
        driver.gpu_time_ns = static_cast<std::uint64_t>((clock.now() + 4s).count());
        driver.execute_marks(marks);
    }
    /// Thread a waits for all that it has launched.
    void finish() {
        const runtime::Wait wait = begin_wait(thread_a, kStreamA);
        execute(20);
        rt().waits().after(thread_a, wait, true);
    }
    progress::TaskPosition tight() { return rt().progress().position("tight", "detect").value(); }
};

}  // namespace

TEST_CASE("Between marks, time tells which kernel the GPU is at", "[runtime][progress]") {
    Watched f;
    CHECK_FALSE(f.rt().progress().position("tight", "detect"));  // nothing was launched yet
    CHECK_FALSE(f.rt().progress().position("tight", "track"));
    CHECK_FALSE(f.rt().progress().position("slack", "detect"));
    f.launch_a(6);
    REQUIRE(f.driver.marks.size() == 3);
    CHECK_FALSE(f.tight().at.busy);  // it is on its way to the GPU
    CHECK(f.tight().at.position == 0);
    CHECK(f.tight().at.unexecuted == 600us);
    CHECK(f.tight().remaining == 2ms);
    f.clock.advance(53us);
    CHECK(f.tight().at.busy);
    CHECK(f.tight().at.position == 0);
    CHECK(f.tight().at.unexecuted == 550us);
    CHECK(f.tight().remaining == 1950us);
    CHECK(f.tight().at.uncertain == 200us);
    f.clock.advance(100us);
    CHECK(f.tight().at.position == 1);
    f.clock.advance(10ms);  // never past a mark that has not executed
    CHECK(f.tight().at.position == 1);
    CHECK(f.tight().at.busy);
    CHECK(f.tight().at.overdue);
    CHECK(f.tight().at.unexecuted == 400us);

    f.execute(1);  // some time in those 10 ms, for all that is known of the GPU's clock
    CHECK(f.tight().at.position >= 2);
    f.launch_a(1);  // sees it
    f.clock.advance(140us);
    CHECK(f.tight().at.position == 3);
    CHECK(f.tight().at.instance == 1);
    f.execute(2);
    f.clock.advance(1ms);
    CHECK_FALSE(f.tight().at.busy);  // behind the last mark there is one launch
    CHECK(f.tight().at.position == 7);
    CHECK(f.tight().at.unexecuted == 0us);
    CHECK(f.tight().remaining == 1300us);
}

TEST_CASE("The stamp of a mark says when it ran, however late it is seen", "[runtime][progress]") {
    Watched f;
    f.launch_a(2);
    f.execute(1);
    (void)f.tight();  // seen at once: now the GPU's clock is known
    f.launch_a(4);
    REQUIRE(f.rt().progress().gpu_clock().restarts() == 1);
    f.clock.advance(200us);
    f.execute(1);
    f.clock.advance(140us);  // nobody looked
    CHECK(f.tight().at.position == 5);
    const auto unexecuted = f.tight().at.unexecuted;
    CHECK(unexecuted > 58us);
    CHECK(unexecuted < 62us);
}

TEST_CASE("A mark that is lost leaves the position to the next one", "[runtime][progress]") {
    Watched f;
    f.launch_a(6);
    REQUIRE(f.driver.marks.size() == 3);
    f.driver.marks.pop_front();
    f.clock.advance(10ms);
    CHECK(f.tight().at.position == 1);
    f.execute(1);
    CHECK(f.tight().at.position >= 4);
    CHECK(f.tight().at.unexecuted <= 200us);
}

TEST_CASE("What the program has waited for has executed, though its mark is not seen yet",
          "[runtime][progress]") {
    Watched f;
    f.launch_a(3);
    f.rt().waits().after(f.thread_a, f.begin_wait(f.thread_a, kStreamA), true);
    REQUIRE_FALSE(f.driver.marks.empty());  // as with events, which a thread asks for later
    CHECK_FALSE(f.tight().at.busy);
    CHECK(f.tight().at.unexecuted == 0ns);
    CHECK(f.tight().at.uncertain == 0ns);
}

TEST_CASE("An instance that begins before the last one is done is not the one on the GPU",
          "[runtime][progress]") {
    Watched f;
    f.launch_a(4);
    f.rt().frames().task_end(f.thread_a);
    f.begin(f.thread_a, "tight");
    f.launch_a(2);
    REQUIRE(f.driver.marks.size() == 3);
    CHECK(f.tight().at.instance == 1);
    CHECK(f.tight().at.position == 0);
    CHECK(f.tight().at.unexecuted == 600us);
    CHECK(f.tight().remaining == 2400us);
    f.execute(2);
    CHECK(f.tight().at.instance == 2);
    CHECK(f.tight().at.position == 0);
    CHECK(f.tight().at.unexecuted == 200us);
}

TEST_CASE("The position outlives the log's ring, the marks' ring and the marks' tags",
          "[runtime][progress]") {
    Watched f;
    f.clock.on_sleep = [&] { f.execute(1); };
    int wrong = 0;
    for (int instance = 1; instance <= 7000; ++instance) {
        for (int i = 0; i < 20; ++i) {
            f.clock.advance(3us);
            f.launch_a(1);
            if (!f.driver.marks.empty()) {
                const auto at = f.tight().at;
                wrong += at.instance != static_cast<std::uint16_t>(instance);
                wrong += at.position >= static_cast<std::uint32_t>(i + 1);
            }
        }
        f.clock.advance(2ms);
        f.finish();
        const auto at = f.tight().at;
        wrong += at.busy || at.position != 20 || at.unexecuted.count() != 0;
        f.rt().frames().task_end(f.thread_a);
        f.begin(f.thread_a, "tight");
    }
    CHECK(wrong == 0);
    CHECK(f.stats(0).tasks.marks > 66'000);
}

TEST_CASE("Tasks side by side have positions of their own", "[runtime][progress]") {
    Watched f;
    f.launch_a(4);
    f.execute(2);
    const auto loose = f.rt().progress().position("loose", "detect").value();
    CHECK(loose.at.position == 0);
    CHECK(loose.at.unexecuted == 100us);
    CHECK(f.tight().at.position == 4);
}

TEST_CASE("A task whose launches overlap is told by time and by its waits", "[runtime][progress]") {
    Watched f;
    Launch dependent{kConv, 100, 256, kStreamA};
    dependent.depends_on_previous = true;
    f.launch_a(1);
    for (int i = 0; i < 2; ++i)
        f.rt().launches().after(f.thread_a, dependent,
                                f.rt().launches().before(f.thread_a, dependent), true);
    REQUIRE(f.driver.marks.empty());  // of 400 us it would be
    f.clock.advance(253us);
    CHECK(f.tight().at.position == 2);
    CHECK(f.tight().at.uncertain == 300us);
    f.clock.advance(10ms);
    CHECK_FALSE(f.tight().at.busy);
    CHECK(f.tight().at.position == 3);
    f.launch_a(1);
    f.finish();
    CHECK(f.tight().at.position == 4);
    CHECK(f.tight().at.unexecuted == 0us);
}

TEST_CASE("A graph is one launch", "[runtime][progress]") {
    Watched f;
    Launch graph;
    graph.graph = reinterpret_cast<CUgraphExec>(0x9);
    graph.stream = kStreamA;
    f.launch_a(1);
    f.rt().launches().after(f.thread_a, graph, f.rt().launches().before(f.thread_a, graph), true);
    f.clock.advance(603us);
    CHECK(f.tight().at.position == 1);
    CHECK(f.tight().at.busy);
    CHECK(f.tight().at.unexecuted == 500us);  // of 1 ms, as long as nothing is known of it
    f.finish();
    CHECK(f.tight().at.position == 2);
    CHECK(f.tight().at.unexecuted == 0us);
}

TEST_CASE("The GPU is seen at launches that nobody was asked about",
          "[runtime][progress][as_planned]") {
    Fixture f;
    f.resolved.config.scheduler.progress.mark_every = 250us;  // five kernels, alone
    f.close_segments();
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    const auto tight = [&] { return f.rt().progress().position("tight", "detect").value(); };
    for (int i = 1; i < 5; ++i)
        REQUIRE(f.launch_as_interposed(f.thread_a, {kConv, 100, 256, kStreamA}));
    f.clock.advance(33us);
    CHECK(tight().at.position == 0);
    CHECK(tight().at.unexecuted == 470us);
    CHECK(tight().remaining == 1970us);
    f.clock.advance(220us);
    CHECK(tight().at.position == 2);
    CHECK(tight().at.busy);
    CHECK(tight().at.unexecuted == 250us);
    CHECK(tight().at.uncertain == 500us);
    f.clock.advance(10ms);
    CHECK(tight().at.position == 5);
    CHECK_FALSE(tight().at.busy);
    CHECK(tight().at.unexecuted == 0us);
    CHECK(tight().remaining == 1500us);
    f.launch(f.thread_a);
    CHECK(tight().at.position == 5);
    f.wait(f.thread_a, kStreamA);
    CHECK(tight().at.position == 6);
    for (int i = 0; i < 2; ++i) f.launch_as_interposed(f.thread_a, {kConv, 100, 256, kStreamA});
    CHECK(tight().at.position == 6);
    CHECK(tight().at.unexecuted == 200us);
}

TEST_CASE("Every launch is marked where asked for, once, alone on the GPU and beside others",
          "[runtime][progress]") {
    const bool alone = GENERATE(true, false);
    Fixture f;
    f.close_segments();
    f.resolved.config.scheduler.progress.mark_every = 0us;
    if (!alone) {
        f.begin(f.thread_b, "loose");
        f.launch(f.thread_b, kStreamB);
    }
    const std::size_t before = f.driver.marks.size();
    f.begin(f.thread_a, "tight");
    for (std::size_t i = 1; i <= 3; ++i) {
        CHECK_FALSE(f.launch_as_interposed(f.thread_a, {kConv, 100, 256, kStreamA}));
        CHECK(f.driver.marks.size() == before + i);
    }
}

TEST_CASE("Beside others, a task's position moves at the pace of its last marks",
          "[runtime][progress]") {
    Watched f;
    f.launch_a(2);
    f.execute(1);  // at once: the clocks are known
    REQUIRE(f.tight().at.executed == 200us);
    f.launch_a(10);  // marks behind 4, 6, ... 12
    REQUIRE(f.driver.marks.size() == 5);
    // Each two kernels of 100 us take 400.
    for (int i = 0; i < 4; ++i) {
        f.clock.advance(400us);
        f.execute(1);
        f.tight();
    }
    REQUIRE(f.tight().at.executed < 1'010us);
    f.clock.advance(150us);
    CHECK(f.tight().at.executed > 1'090us);
    CHECK(f.tight().at.executed < 1'120us);  // and not 1150
}

TEST_CASE("A mark that was not executed yet at the last look tells of the GPU's clock",
          "[runtime][progress]") {
    Watched f;
    f.launch_a(4);  // two marks
    f.clock.advance(500us);
    f.launch_a(1);  // looks
    f.clock.advance(3us);
    f.execute(1);
    f.clock.advance(3us);
    (void)f.tight();
    const auto known = f.rt().progress().gpu_clock().to_host(f.driver.gpu_time_ns);
    REQUIRE(known);
    CHECK(known->error < 8us);  // and not half of the time since it was launched
    CHECK(std::abs((known->time - (f.clock.now() - 3us)).count()) < 5'000);
}

TEST_CASE("No more marks are under way than a reader can find", "[runtime][progress]") {
    Watched f;
    f.runtime.reset();  // the settings count from the beginning
    for (ThreadState* const thread : {&f.thread_a, &f.thread_b}) {
        std::destroy_at(thread);
        std::construct_at(thread);
    }
    f.driver.marks.clear();
    f.resolved.config.scheduler.run_ahead.limit = 100ms;
    f.resolved.config.scheduler.progress.mark_every = 0us;
    f.begin(f.thread_a, "tight");
    f.launch_a(abi::kMarkRing);
    // The more there are, the farther apart they are.
    CHECK(f.driver.marks.size() > abi::kMarkRing / 2);
    CHECK(f.driver.marks.size() < abi::kMarkRing - 2);
    f.launch_a(3 * abi::kMarkRing);
    CHECK(f.driver.marks.size() == abi::kMarkRing - 2);
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_b, kStreamB);
    const std::size_t with_other = f.driver.marks.size();
    f.wait_a();  // beside others a wait has a mark before it
    CHECK(f.driver.marks.size() == with_other);
    CHECK(f.tight().at.position == 0);
    f.execute(50);
    f.launch_a(2);
    CHECK(f.driver.marks.size() > abi::kMarkRing - 52);
}
