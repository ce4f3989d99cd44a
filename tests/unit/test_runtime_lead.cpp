// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "tests/support/runtime_fixture.h"

namespace urgengo::testing {
namespace {

// Chains with long instances, which may be 4 ms ahead of the GPU where they are by themselves.
struct RuntimeLeadTest : RuntimeFixture {
    explicit RuntimeLeadTest(double utilization = 1.0) : RuntimeFixture(utilization) {
        resolved.config.scheduler.run_ahead.alone = 4ms;
        for (auto& chain : resolved.profile->chains)
            chain.tasks[0].kernels.assign(100, {"conv", 100, 256, 100us, utilization});
        clock.on_sleep = [this] { catch_up(); };
    }
    /// The GPU does all that there is.
    void catch_up() { driver.execute_marks(driver.marks.size()); }
    /// How many launches go before one has to wait.
    int launched_before_a_sleep() {
        const int sleeps = clock.num_sleeps;
        int launched = 0;
        for (; clock.num_sleeps == sleeps; ++launched) {
            REQUIRE(launched < 1000);
            launch(thread_a);
        }
        return launched - 1;
    }
    /// `loose` has had the GPU to itself for so long, and begins a frame.
    void be_alone(std::chrono::nanoseconds time = 1001ms) {
        rt();
        clock.advance(time);
        begin(thread_a, "loose");
    }
    /// The thread has waited for all that it launched on the stream.
    void end(ThreadState& thread, CUstream stream) {
        const auto wait = begin_wait(thread, stream);
        catch_up();
        rt().waits().after(thread, wait, true);
        rt().frames().task_end(thread);
    }
};

const CUstream kStreamC = reinterpret_cast<CUstream>(0xc0);

// And `mid`, with a deadline of 50 ms.
struct ThreeChains : RuntimeLeadTest {
    ThreadState thread_c;
    ThreeChains() : RuntimeLeadTest(0.3) {
        config::Chain mid = resolved.config.chains[0];
        mid.name = "mid";
        mid.deadline = 50ms;
        mid.tasks = {{"detect", "th_mid"}};
        resolved.config.chains.push_back(mid);
        resolved.profile->chains.push_back({"mid", {profile_of("detect", 100, 100us, 0.3)}});
    }
};

constexpr int kAhead = 11;  // launches of 100 us, with a run-ahead of 1 ms

}  // namespace

TEST_CASE("Runtime lets a task run further ahead where nobody else has been for a second",
          "[runtime][lead]") {
    RuntimeLeadTest f;
    f.begin(f.thread_a, "loose");
    CHECK(f.launch(f.thread_a).priority == -5);
    f.wait_a();
    f.clock.advance(1001ms);
    f.begin(f.thread_a, "loose");
    CHECK(f.launch(f.thread_a).priority == -2);
    CHECK(f.launched_before_a_sleep() >= 39);
    CHECK(f.stats(1).tasks.marks <= 3);
    f.wait_a();
    // Who comes overtakes what is under way.
    for (int i = 0; i < 30; ++i) f.launch(f.thread_a);
    f.begin(f.thread_b, "tight");
    CHECK(f.launch(f.thread_b, kStreamB).priority == -5);
    CHECK(f.launch(f.thread_a).priority >= -4);
    f.rt().frames().task_end(f.thread_b);
    f.wait_a();
    // It was there just now.
    CHECK(f.launch(f.thread_a).priority == -5);
    CHECK(f.launched_before_a_sleep() <= kAhead);
    f.wait_a();
    f.clock.advance(999ms);
    CHECK(f.launch(f.thread_a).priority == -5);
    f.wait_a();
    f.clock.advance(5ms);
    CHECK(f.launch(f.thread_a).priority == -2);
    CHECK(f.launched_before_a_sleep() > 30);
}

TEST_CASE("Runtime gives no task more run-ahead that it cannot launch below who comes",
          "[runtime][lead]") {
    RuntimeLeadTest f;
    auto& scheduler = f.resolved.config.scheduler;
    SECTION("Of two levels one is everybody's who has none") {
        scheduler.priority.levels = 2;
    }
    SECTION("There is one level") {
        scheduler.priority.levels = 1;
    }
    SECTION("Binding none") {
        scheduler.binding = config::Binding::kNone;
    }
    SECTION("Binding static") {
        scheduler.binding = config::Binding::kStatic;
    }
    SECTION("Binding task") {
        scheduler.binding = config::Binding::kTask;
    }
    f.be_alone();
    CHECK(f.launched_before_a_sleep() <= kAhead);
}

TEST_CASE("Runtime leads below who comes with three levels, too", "[runtime][lead]") {
    RuntimeLeadTest f;
    f.resolved.config.scheduler.priority.levels = 3;
    f.be_alone();
    CHECK(f.launch(f.thread_a).priority == -4);
    CHECK(f.launched_before_a_sleep() >= 38);
}

TEST_CASE("A program's wish for a priority lifts no lead to that of who comes", "[runtime][lead]") {
    RuntimeLeadTest f;
    f.driver.own_priority = -1;  // of the stream
    f.be_alone();
    CHECK(f.launch(f.thread_a).priority == -2);
    const Launch urgent{.function = kConv,
                        .grid_blocks = 100,
                        .block_threads = 256,
                        .stream = kStreamA,
                        .asks_priority = true,
                        .priority = -5};
    const Grant grant = f.rt().launches().before(f.thread_a, urgent);
    CHECK(grant.priority == -2);
    f.rt().launches().after(f.thread_a, urgent, grant, true);
    f.begin(f.thread_b, "tight");
    CHECK(f.launch(f.thread_b, kStreamB).priority == -5);
}

TEST_CASE("Who comes and is less urgent stays behind what a leader has under way",
          "[runtime][lead]") {
    RuntimeLeadTest f(0.5);  // two fit
    f.resolved.config.scheduler.admission =
        GENERATE(config::Admission::kNone, config::Admission::kPacked);
    f.rt();
    f.clock.advance(1001ms);
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 30; ++i) f.launch(f.thread_a);
    f.begin(f.thread_b, "loose");
    CHECK(f.launch(f.thread_b, kStreamB).priority == -1);
    CHECK(f.launch(f.thread_a).priority == -5);
    // When that is over, it takes the next level, as usual.
    f.end(f.thread_b, kStreamB);
    f.end(f.thread_a, kStreamA);
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    f.begin(f.thread_b, "loose");
    CHECK(f.launch(f.thread_b, kStreamB).priority == -4);
}

TEST_CASE("Who comes is behind a lead until marks tell that the GPU has got through it",
          "[runtime][lead]") {
    RuntimeLeadTest f(0.5);
    f.resolved.config.scheduler.admission = config::Admission::kNone;
    f.resolved.config.scheduler.run_ahead.limit = 3ms;
    f.rt();
    f.clock.advance(1001ms);
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 20; ++i) f.launch(f.thread_a);
    f.begin(f.thread_b, "loose");
    CHECK(f.launch(f.thread_b, kStreamB).priority == -1);
    // What may have gone unasked of the lead, and more.
    for (int i = 0; i < 70; ++i) {
        f.launch(f.thread_a);
        f.catch_up();
    }
    CHECK(f.launch(f.thread_b, kStreamB).priority == -4);
}

TEST_CASE("A wish lifts nobody to the level of a lead", "[runtime][lead]") {
    RuntimeLeadTest f(0.5);
    f.driver.own_priority = -1;
    f.resolved.config.scheduler.admission = config::Admission::kNone;
    f.rt();
    f.clock.advance(1001ms);
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 30; ++i) f.launch(f.thread_a);
    f.begin(f.thread_b, "loose");
    CHECK(f.launch(f.thread_b, kStreamB).priority == -1);
}

TEST_CASE("Who comes second and is more urgent than the leader is not behind its lead",
          "[runtime][lead]") {
    ThreeChains f;
    f.resolved.config.scheduler.admission =
        GENERATE(config::Admission::kNone, config::Admission::kPacked);
    f.be_alone();
    for (int i = 0; i < 30; ++i) CHECK(f.launch(f.thread_a).priority == -2);
    f.begin(f.thread_b, "tight");
    CHECK(f.launch(f.thread_b, kStreamB).priority == -5);
    f.begin(f.thread_c, "mid");
    CHECK(f.launch(f.thread_c, kStreamC).priority == -4);
}

TEST_CASE("A lead that is over takes no level from anybody", "[runtime][lead]") {
    ThreeChains f;
    f.resolved.config.scheduler.admission = config::Admission::kNone;
    f.resolved.config.scheduler.priority.levels = 3;
    f.be_alone();
    for (int i = 0; i < 30; ++i) f.launch(f.thread_a);
    f.end(f.thread_a, kStreamA);
    f.begin(f.thread_b, "tight");
    f.launch(f.thread_b, kStreamB);
    f.begin(f.thread_c, "mid");
    f.launch(f.thread_c, kStreamC);
    f.begin(f.thread_a, "loose");
    f.launch(f.thread_a);
    CHECK(f.launch(f.thread_b, kStreamB).priority == -5);
    CHECK(f.launch(f.thread_c, kStreamC).priority == -4);
    CHECK(f.launch(f.thread_a).priority == -3);
}

TEST_CASE("A chain that is only observed is company", "[runtime][lead]") {
    RuntimeLeadTest f;
    f.resolved.config.chains[0].mode = config::Mode::kObserve;
    f.rt();
    for (int i = 0; i < 11; ++i) {
        f.begin(f.thread_b, "tight");
        f.launch(f.thread_b, kStreamB);
        f.end(f.thread_b, kStreamB);
        f.clock.advance(100ms);
    }
    f.begin(f.thread_a, "loose");
    CHECK(f.launched_before_a_sleep() <= kAhead);
}

TEST_CASE("Chains that take turns are marked no more often than one that is alone",
          "[runtime][lead]") {
    const auto marks = [](bool turns) {
        RuntimeLeadTest f;
        f.resolved.config.scheduler.run_ahead.alone = 0us;
        for (int i = 0; i < 40; ++i) {
            const bool odd = turns && i % 2;
            ThreadState& thread = odd ? f.thread_b : f.thread_a;
            const CUstream stream = odd ? kStreamB : kStreamA;
            f.rt();
            f.clock.advance(60ms);
            f.begin(thread, odd ? "tight" : "loose");
            for (int k = 0; k < 100; ++k) f.launch(thread, stream);
            f.clock.advance(30ms);  // no shorter than estimated
            f.end(thread, stream);
        }
        return f.stats(0).tasks.marks + f.stats(1).tasks.marks;
    };
    CHECK(marks(true) == marks(false));
}

TEST_CASE("Another's call that waits for the whole GPU is company", "[runtime][lead]") {
    RuntimeLeadTest f;
    f.be_alone();
    for (int i = 0; i < 5; ++i) f.launch(f.thread_a);
    f.begin(f.thread_b, "tight");
    f.rt().waits().implicit_sync_begins(f.thread_b);
    f.catch_up();
    f.rt().waits().implicit_sync_ended(f.thread_b);
    f.wait_a();
    CHECK(f.launch(f.thread_a).priority == -5);
    CHECK(f.launched_before_a_sleep() <= kAhead);
}

TEST_CASE("Chains that take turns on the GPU are each other's company", "[runtime][lead]") {
    RuntimeLeadTest f;
    f.rt();
    f.clock.advance(1001ms);
    for (int i = 0; i < 50; ++i) {
        f.begin(f.thread_b, "tight");
        for (int k = 0; k < 3; ++k) f.launch(f.thread_b, kStreamB);
        f.end(f.thread_b, kStreamB);
        f.clock.advance(25ms);
        f.begin(f.thread_a, "loose");
        CHECK(f.launch(f.thread_a).priority == -5);
        f.end(f.thread_a, kStreamA);
        f.clock.advance(25ms);
    }
    f.begin(f.thread_a, "loose");
    CHECK(f.launched_before_a_sleep() <= kAhead);
}

TEST_CASE("A task alone is by itself where none of the chains has come for two of its periods",
          "[runtime][lead]") {
    RuntimeLeadTest f;
    f.resolved.config.chains[0].period = 700ms;
    f.be_alone(1399ms);
    CHECK(f.launch(f.thread_a).priority == -5);
    f.clock.advance(2ms);
    CHECK(f.launch(f.thread_a).priority == -2);
}

TEST_CASE("With a run-ahead that is short a lead is marked by it", "[runtime][lead]") {
    RuntimeLeadTest f;
    f.resolved.config.scheduler.run_ahead.limit = 300us;
    for (auto& chain : f.resolved.profile->chains)
        chain.tasks[0].kernels.assign(100, {"conv", 100, 256, 1'800us, 1.0});
    f.be_alone();
    for (int i = 0; i < 2; ++i) f.launch(f.thread_a);
    CHECK(f.driver.marks.size() >= 1);
}

TEST_CASE("A task that is slow no more is no further ahead than a lead may be", "[runtime][lead]") {
    RuntimeLeadTest f;
    for (auto& chain : f.resolved.profile->chains) {
        auto& kernels = chain.tasks[0].kernels;
        kernels.assign(20, {"conv", 100, 256, 5us, 1.0});
        kernels.resize(100, {"conv", 100, 256, 600us, 1.0});
    }
    f.be_alone();
    for (int i = 0; i < 20; ++i) {
        f.launch(f.thread_a);
        f.clock.advance(250us);
    }
    int launched = 0;
    for (; f.driver.marks.empty(); ++launched) {
        REQUIRE(launched < 80);
        f.launch(f.thread_a);
    }
    CHECK(launched <= 4ms / 600us + 1);
}

}  // namespace urgengo::testing
