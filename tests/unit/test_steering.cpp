// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/steering.h"

#include "tests/support/nice_value.h"
#include "tests/support/steering_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using abi::ControlCommand;
using abi::StatusMode;
using config::Mode;
using Fixture = SteeringFixture;

TEST_CASE("Steering ends a hold at its next look, and the run with it", "[runtime][steering]") {
    Fixture f;
    f.begin_both();
    const auto command = GENERATE(ControlCommand::kOff, ControlCommand::kObserve);
    f.clock.on_sleep = [&] {
        f.clock.on_sleep = {};  // it sleeps itself, until the hold has ended
        f.steer(command);
    };
    const Grant held = f.launch(f.thread_b, kStreamB);
    CHECK(held.task != nullptr);
    CHECK(f.page().tasks[1].state != abi::TaskState::kHeld);
    CHECK(f.header().control_seen == f.word);
    const bool is_off = command == ControlCommand::kOff;
    CHECK(f.header().mode == (is_off ? StatusMode::kOff : StatusMode::kObserve));
    CHECK(f.header().holds_left == 1);  // the word was obeyed inside the hold
    f.steer(command);
    CHECK(f.header().holds_left == 0);
    // The run of the thread that was held ended as it let go of its task.
    CHECK((f.page().tasks[1].state == abi::TaskState::kIdle) == is_off);
    CHECK((f.page().tasks[0].state == abi::TaskState::kIdle) == is_off);
    const int sleeps = f.clock.num_sleeps;
    CHECK((f.launch(f.thread_b, kStreamB).task == nullptr) == is_off);
    CHECK(f.clock.num_sleeps == sleeps);
}

TEST_CASE("Steering off leaves no run behind, and what comes after on is a new one",
          "[runtime][steering]") {
    Fixture f;
    f.begin_both();
    f.steer(ControlCommand::kOff);
    CHECK(f.page().on_gpu == 0);
    CHECK(f.page().active[0] == 0);
    CHECK(f.launch(f.thread_a).task == nullptr);
    f.wait(f.thread_a, kStreamA);
    f.rt().frames().task_end(f.thread_a);
    CHECK(f.rt().frames().arrival(nullptr, "tight", f.clock.now()) == 0);

    f.steer(ControlCommand::kOn);
    CHECK(f.header().mode == StatusMode::kEnforce);
    f.begin(f.thread_a, "tight");
    const Grant grant = f.launch(f.thread_a);
    CHECK(grant.scheduled);
    CHECK(f.page().on_gpu == 1);
    f.rt().frames().task_end(f.thread_a);
    CHECK(f.page().on_gpu == 0);
    CHECK(f.stats(0).frames.instances == 2);
    CHECK(f.stats(0).frames.finished == 2);
}

TEST_CASE("Steering off leaves no frame between two tasks", "[runtime][steering]") {
    Fixture f;
    f.resolved.config.chains[1].tasks = {{"detect", "first"}, {"track", "second"}};
    {
        const ThreadName name("first");
        f.launch(f.thread_a);
        f.wait(f.thread_a, kStreamA);
    }
    f.steer(ControlCommand::kOff);
    f.clock.advance(50ms);
    f.steer(ControlCommand::kOn);
    const nanoseconds on = f.clock.now();
    f.clock.advance(30ms);
    const ThreadName name("second");
    const Grant grant = f.launch(f.thread_b, kStreamB);
    REQUIRE(grant.task != nullptr);
    CHECK(grant.task->tracked.arrival >= on);
    CHECK(f.stats(1).frames.missed == 0);
}

TEST_CASE("Steering to observe takes tasks from the GPU at their next launch, and counts on",
          "[runtime][steering]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    REQUIRE(f.page().on_gpu == 1);
    const auto marks = f.driver.marks.size();
    f.steer(ControlCommand::kObserve);
    for (int i = 0; i < 10; ++i) {
        const Grant grant = f.launch(f.thread_a);
        CHECK(grant.task != nullptr);
        CHECK_FALSE(grant.scheduled);
        CHECK_FALSE(grant.set_priority);
    }
    CHECK(f.page().on_gpu == 0);
    CHECK(f.driver.marks.size() == marks);
    CHECK(f.stats(0).tasks.launches == 11);
    f.steer(ControlCommand::kOn);
    CHECK(f.launch(f.thread_a).scheduled);
    CHECK(f.page().on_gpu == 1);
}

TEST_CASE("Steering to shadow counts what would be held, and holds and changes nothing",
          "[runtime][steering]") {
    Fixture f;
    f.begin_both();
    f.steer(ControlCommand::kShadow);
    CHECK(f.header().mode == StatusMode::kShadow);
    const auto marks = f.driver.marks.size();
    for (int i = 0; i < 5; ++i) {
        const Grant grant = f.launch(f.thread_b, kStreamB);
        CHECK(grant.scheduled);
        CHECK_FALSE(grant.set_priority);
        f.clock.advance(100us);
    }
    CHECK(f.clock.num_sleeps == 0);
    CHECK(f.driver.marks.size() > marks);  // it is known where the GPU is
    CHECK(f.page().tasks[1].state == abi::TaskState::kGpu);
    CHECK(f.page().tasks[1].queue_why == abi::Why::kNone);
    f.driver.execute_marks(100);
    f.wait(f.thread_b, kStreamB);
    f.rt().frames().task_end(f.thread_b);
    const abi::ChainStatus& loose = f.rt().status().chain(1);
    CHECK(loose.would_hold > 0);
    CHECK(loose.would_hold <= 5);
    CHECK(loose.would_held_ns >= 100'000);
    CHECK(loose.would_held_ns <= 500'000);
    CHECK(loose.would_behind == 1);
    CHECK(loose.holds == 0);
    CHECK(loose.held_ns == 0);
    CHECK(f.rt().status().chain(0).would_hold == 0);
    // And on again, what would have been held is.
    f.steer(ControlCommand::kOn);
    CHECK(f.header().mode == StatusMode::kEnforce);
    CHECK(f.launch(f.thread_a).set_priority);
}

TEST_CASE("Steering to shadow ends a hold at its next look", "[runtime][steering]") {
    Fixture f;
    f.begin_both();
    f.clock.on_sleep = [&] {
        f.clock.on_sleep = {};
        f.steer(ControlCommand::kShadow);
    };
    CHECK(f.launch(f.thread_b, kStreamB).task != nullptr);
    const int sleeps = f.clock.num_sleeps;
    f.launch(f.thread_b, kStreamB);
    CHECK(f.clock.num_sleeps == sleeps);
}

TEST_CASE("Steering on is what the config says", "[runtime][steering]") {
    Fixture f;
    const auto [mode, shown] = GENERATE(std::pair{Mode::kObserve, StatusMode::kObserve},
                                        std::pair{Mode::kShadow, StatusMode::kShadow});
    f.resolved.config.mode = mode;
    CHECK(f.header().mode == shown);
    f.steer(ControlCommand::kOff);
    f.steer(ControlCommand::kOn);
    CHECK(f.rt().mode() == shown);
    f.begin_both();
    const Grant grant = f.launch(f.thread_b, kStreamB);
    CHECK(grant.scheduled == (mode == Mode::kShadow));
    CHECK_FALSE(grant.set_priority);
    CHECK(f.clock.num_sleeps == 0);
}

TEST_CASE("Steering refuses what means nothing, and anything once UrgenGo is off for good",
          "[runtime][steering]") {
    Fixture f;
    f.steer(ControlCommand::kNone);
    f.steer(ControlCommand{200});
    CHECK(f.header().control_refused == 2);
    CHECK(f.header().control_seen == f.word);
    CHECK(f.rt().mode() == StatusMode::kEnforce);
    f.rt().trip();
    for (const auto command : {ControlCommand::kOn, ControlCommand::kShadow}) {
        f.steer(command);
        CHECK(f.rt().mode() == StatusMode::kObserve);
        CHECK(f.header().mode == StatusMode::kTripped);
    }
    CHECK(f.header().control_refused == 4);
    if (GENERATE(false, true)) {
        f.rt().stop();
    } else {
        f.steer(ControlCommand::kOff);  // it may be told to do less
        CHECK(f.header().control_refused == 4);
    }
    f.steer(ControlCommand::kObserve);
    CHECK(f.header().control_refused == 5);
    CHECK(f.rt().mode() == StatusMode::kOff);
    CHECK(f.header().mode == StatusMode::kTripped);
}

TEST_CASE("Runtime that has tripped counts frames, and changes nothing", "[runtime][steering]") {
    Fixture f;
    f.begin_both();
    f.rt().trip();
    const int sleeps = f.clock.num_sleeps;
    for (int i = 0; i < 3; ++i) {
        f.begin(f.thread_b, "loose");
        const Grant grant = f.launch(f.thread_b, kStreamB);
        CHECK_FALSE(grant.scheduled);
        CHECK_FALSE(grant.set_priority);
        f.wait(f.thread_b, kStreamB);
        f.rt().frames().task_end(f.thread_b);
    }
    CHECK(f.clock.num_sleeps == sleeps);
    CHECK(f.stats(1).frames.finished == 4);  // with the one that was under way
}

TEST_CASE("Chain's numbers stand in the status page when a frame has ended",
          "[runtime][status_page]") {
    Fixture f;
    for (const auto latency : {10ms, 30ms}) {
        f.begin(f.thread_a, "tight");
        f.launch(f.thread_a);
        f.clock.advance(latency);
        f.wait(f.thread_a, kStreamA);
        f.rt().frames().task_end(f.thread_a);
    }
    const abi::ChainStatus& chain = f.rt().status().chain(0);
    CHECK(chain.instances == 2);
    CHECK(chain.finished == 2);
    CHECK(chain.missed == 1);
    CHECK(chain.misses_in_a_row == 1);
    CHECK(chain.launches == 2);
    CHECK(chain.latency_max_ns == 30'000'000);
    CHECK(chain.frames == 2);
    CHECK(chain.ring[0].latency_us == 10'000);
    CHECK(chain.ring[1].latency_us == 30'000);
    CHECK(chain.ring[1].end_ns == f.clock.now().count());
    CHECK(f.rt().status().task(0).num_kernels == 20);
    CHECK(f.rt().status().task(0).planned_gpu_ns == 2'000'000);
    CHECK(f.rt().status().chain(1).instances == 0);
}

TEST_CASE("Threads of chains have their own nice value while less than scheduling is asked for",
          "[runtime][steering][thread_nice]") {
    constexpr int kNice = -5;
    Fixture f;
    f.resolved.config.nice = kNice;
    const auto command =
        GENERATE(ControlCommand::kOff, ControlCommand::kObserve, ControlCommand::kShadow);
    int scheduled = 1, steered = 1, in_next = 1, anew = 1;
    std::thread([&] {
        f.begin(f.thread_a, "tight");
        scheduled = own_nice();
        f.steer(command);
        steered = own_nice();
        f.rt().frames().task_end(f.thread_a);
        if (command != ControlCommand::kOff) f.begin(f.thread_a, "tight");  // else none arrives
        in_next = own_nice();
        f.rt().frames().task_end(f.thread_a);
        f.steer(ControlCommand::kOn);
        f.begin(f.thread_a, "tight");
        anew = own_nice();
    }).join();
    const int expected = may_be_nice(kNice) ? kNice : 0;
    CHECK(scheduled == expected);
    CHECK(steered == 0);
    CHECK(in_next == 0);
    CHECK(anew == expected);
}
