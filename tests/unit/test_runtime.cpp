// SPDX-License-Identifier: Apache-2.0
//
// The runtime in virtual time, against a driver that executes marks when the test says so.
#include <unistd.h>

#include <atomic>
#include <thread>

#include "tests/support/runtime_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using config::Mode;
using Fixture = RuntimeFixture;

TEST_CASE("Runtime leaves work of no chain untouched", "[runtime]") {
    Fixture f;
    const Grant g = f.launch(f.thread_a);
    CHECK(g.task == nullptr);
    CHECK_FALSE(g.set_priority);
    CHECK(f.driver.marks.empty());
}

TEST_CASE("Runtime grants a task that is alone at once and at the highest priority", "[runtime]") {
    Fixture f;
    f.begin(f.thread_a, "loose");
    const Grant g = f.launch(f.thread_a);
    CHECK(g.set_priority);
    CHECK(g.priority == -5);
    CHECK(f.clock.num_sleeps == 0);
}

TEST_CASE("Runtime marks about every mark_every of estimated work, at the highest priority",
          "[runtime][marks]") {
    Fixture f;
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_b, kStreamB);  // somebody who looks
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 7; ++i) f.launch(f.thread_a);
    REQUIRE(f.driver.marks.size() == 3);  // 200 us are two kernels
    CHECK(f.driver.marks[0].priority == -5);
    CHECK(f.driver.marks[0].stream == kStreamA);
    CHECK(f.driver.marks[0].word0 >> 32 == 2);
    CHECK(f.driver.marks[2].word0 >> 32 == 6);
    f.wait_a();
    REQUIRE(f.driver.marks.size() == 4);
    CHECK(f.driver.marks[3].word0 >> 32 == 7);
    f.wait_a();  // nothing new: no mark
    CHECK(f.driver.marks.size() == 4);
}

TEST_CASE("Runtime marks a task half as often when it is alone on the GPU", "[runtime][marks]") {
    Fixture f;
    f.resolved.config.scheduler.mark_every = 250us;
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 5; ++i) f.launch(f.thread_a);
    CHECK(f.driver.marks.empty());
    f.launch(f.thread_a);  // 500 us are before it
    REQUIRE(f.driver.marks.size() == 1);
    CHECK(f.driver.marks[0].word0 >> 32 == 5);
    f.wait_a();
    CHECK(f.driver.marks.size() == 1);
    f.launch(f.thread_a);
    f.launch(f.thread_a);
    f.begin(f.thread_b, "loose");
    f.driver.execute_marks(1);
    f.clock.on_sleep = [&] { f.clock.advance(1ms); };
    f.launch(f.thread_b, kStreamB);
    f.launch(f.thread_a);  // whoever came finds a mark before the next launch
    CHECK(f.driver.marks.back().word0 >> 32 == 8);
}

TEST_CASE("Runtime adds no late mark to the legacy stream", "[runtime][marks]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a, nullptr);
    f.begin_wait(f.thread_a, nullptr);
    CHECK(f.driver.marks.empty());
}

TEST_CASE("Runtime schedules a run no further when the driver refuses its marks",
          "[runtime][marks]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    f.driver.launch_result = CUDA_ERROR_INVALID_HANDLE;
    for (int i = 0; i < 20; ++i) f.launch(f.thread_a);
    CHECK(f.clock.num_sleeps == 0);
    CHECK(f.stats(0).marks_refused == 1);
    CHECK_FALSE(f.launch(f.thread_a).set_priority);
}

TEST_CASE("Runtime marks no stream but the one that the program's call names", "[runtime][marks]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 3; ++i) f.launch(f.thread_a, kStreamA);
    f.driver.marks.clear();
    const auto event = reinterpret_cast<CUevent>(0xe0);
    f.rt().event_recorded(f.thread_a, event, kStreamA, exec::StreamFlavor::kLegacy, false);
    f.rt().stream_waits(f.thread_a, kStreamB, exec::StreamFlavor::kLegacy, event);
    // The program may destroy stream A from here on.
    for (int i = 0; i < 3; ++i) f.launch(f.thread_a, kStreamB);
    f.wait_a();
    REQUIRE_FALSE(f.driver.marks.empty());
    for (const auto& mark : f.driver.marks) CHECK(mark.stream == kStreamB);
}

TEST_CASE("Runtime launches no mark when another context is current", "[runtime][marks]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    f.driver.context = reinterpret_cast<CUcontext>(0x43);
    f.wait_a();
    CHECK(f.driver.marks.empty());
}

TEST_CASE("Runtime puts nothing before a launch that depends programmatically on the last",
          "[runtime][marks]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_a);
    f.wait_a();
    Launch dependent{kConv, 100, 256, kStreamB};
    dependent.depends_on_previous = true;
    f.driver.marks.clear();
    const auto launch = [&](int count) {
        for (int i = 0; i < count; ++i)
            f.rt().after_launch(f.thread_b, dependent, f.rt().before_launch(f.thread_b, dependent),
                                true);
    };
    launch(3);
    CHECK(f.driver.marks.empty());
    CHECK(f.clock.num_sleeps == 0);
    launch(8);  // but behind one, where others look at it: every 400 us
    CHECK(f.driver.marks.size() == 2);
}

TEST_CASE("Runtime keeps out of a stream that captures", "[runtime][capture]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 3; ++i) f.launch(f.thread_a);
    f.rt().streams().capture_begins(kStreamA, exec::StreamFlavor::kLegacy);
    const auto before = f.driver.marks.size();
    f.driver.capturing = kStreamA;
    for (int i = 0; i < 5; ++i) CHECK(f.launch(f.thread_a).task == nullptr);
    CHECK(f.launch(f.thread_a, kStreamB).task != nullptr);  // others go on
    f.wait_a();
    for (std::size_t i = before; i < f.driver.marks.size(); ++i)
        CHECK(f.driver.marks[i].stream == kStreamB);
    f.driver.capturing = nullptr;
    f.rt().streams().capture_ended(kStreamA, exec::StreamFlavor::kLegacy);
    CHECK(f.launch(f.thread_a).task != nullptr);
}

TEST_CASE("Runtime paces a task that runs ahead until the GPU has caught up", "[runtime][hold]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 10; ++i) f.launch(f.thread_a);
    CHECK(f.clock.num_sleeps == 0);  // 1 ms of run-ahead
    f.clock.on_sleep = [&] {
        if (f.clock.num_sleeps == 3) f.driver.execute_marks(1);
    };
    f.launch(f.thread_a);
    f.launch(f.thread_a);
    CHECK(f.clock.num_sleeps == 3);
    CHECK(f.stats(0).holds == 0);  // nobody was in its way
}

TEST_CASE("Runtime always lets two kernels be queued however long they are", "[runtime][hold]") {
    Fixture f;
    f.resolved.profile->chains[0].tasks[0].kernels.assign(4, {"conv", 100, 256, 5ms, 1.0});
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    f.launch(f.thread_a);
    CHECK(f.clock.num_sleeps == 0);
    f.clock.on_sleep = [&] { f.driver.execute_marks(1); };
    f.launch(f.thread_a);
    CHECK(f.clock.num_sleeps == 1);
}

TEST_CASE("Runtime holds the less urgent task until the more urgent one has finished",
          "[runtime][hold]") {
    Fixture f;
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_b, kStreamB);
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    f.wait_a();            // its thread waits for the GPU
    f.clock.advance(1ms);  // beyond the grace between launches
    f.clock.on_sleep = [&] {
        if (f.clock.num_sleeps == 4) f.driver.execute_marks(1);
    };
    const Grant g = f.launch(f.thread_b, kStreamB);
    CHECK(f.clock.num_sleeps == 4);
    CHECK(g.priority == -5);  // by then alone
    CHECK(f.stats(1).holds == 1);
    CHECK(f.stats(1).held_ns == std::chrono::nanoseconds(200us).count());
    CHECK(f.stats(0).holds == 0);
}

TEST_CASE("Runtime lets small kernels of a less urgent task pass at a lower priority",
          "[runtime][hold]") {
    Fixture f(0.5);
    f.begin(f.thread_a, "tight");
    f.begin(f.thread_b, "loose");
    CHECK(f.launch(f.thread_a).priority == -5);
    CHECK(f.launch(f.thread_b, kStreamB).priority == -4);
    CHECK(f.clock.num_sleeps == 0);
}

TEST_CASE("Runtime does not pace a task whose stream waits for something else", "[runtime][hold]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    // Nothing executes: a stream memory operation waits for this very thread, say.
    for (int i = 0; i < 20; ++i) f.launch(f.thread_a);
    CHECK(f.clock.now() - 1s <= 3ms);
}

TEST_CASE("Runtime counts work that the plan does not know", "[runtime][hold]") {
    Fixture f;
    f.resolved.profile->chains[0].tasks[0].kernels.resize(1);
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_b, kStreamB);
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 3; ++i) f.launch(f.thread_a);  // two more than planned
    f.wait_a();
    f.clock.advance(1ms);
    f.driver.execute_marks(1);
    f.clock.on_sleep = [&] {
        if (f.clock.num_sleeps == 4) f.driver.execute_marks(1);
    };
    f.launch(f.thread_b, kStreamB);
    CHECK(f.clock.num_sleeps == 4);
}

TEST_CASE("Runtime ends a hold when the blocker's mark is overdue", "[runtime][hold]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_a);
    f.wait_a();
    f.launch(f.thread_b, kStreamB);  // the mark never executes: 2 * 100 us + 1 ms
    CHECK(f.clock.num_sleeps >= 24);
    CHECK(f.clock.num_sleeps <= 26);
}

TEST_CASE("Runtime gives overdue work the GPU now and then, the more seldom the longer it waits",
          "[runtime][hold]") {
    Fixture f;
    f.resolved.config.chains[0].deadline = 600ms;
    f.resolved.config.chains[1].deadline = 900ms;
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    f.wait_a();
    f.driver.marks.clear();  // never executes
    f.begin(f.thread_b, "loose");
    // The less urgent one launches every half of a millisecond.
    std::vector<nanoseconds> begins;
    nanoseconds held{0};
    const nanoseconds begin = f.clock.now();
    while (f.clock.now() - begin < 300ms) {
        const nanoseconds before = f.clock.now();
        f.launch(f.thread_b, kStreamB);
        f.driver.execute_marks(1);
        if (f.clock.now() > before) begins.push_back(before - begin);
        held += f.clock.now() - before;
        f.clock.advance(500us);
    }
    REQUIRE(begins.size() == 6);
    CHECK(begins[0] == 0ms);  // until it is overdue
    CHECK(begins[1] > 10ms);
    CHECK(begins[1] < 12ms);
    for (std::size_t i = 2; i < begins.size(); ++i) CHECK(begins[i] > 2 * begins[i - 1]);
    CHECK(held < 300ms / 8);
}

TEST_CASE("Frames are in time beside work that waits for ever for something else",
          "[runtime][hold]") {
    Fixture f;
    f.resolved.config.chains[0].deadline = 100ms;
    f.resolved.config.chains[1].period = f.resolved.config.chains[1].deadline = 33ms;
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    f.wait_a();
    f.driver.marks.clear();  // never executes
    const nanoseconds begin = f.clock.now();
    nanoseconds longest{0};
    while (f.clock.now() - begin < 120s) {
        const nanoseconds frame = f.clock.now();
        f.begin(f.thread_b, "loose");
        for (int i = 0; i < 20; ++i) {
            f.launch(f.thread_b, kStreamB);
            f.driver.execute_marks(static_cast<int>(f.driver.marks.size()));
            f.clock.advance(100us);
        }
        f.rt().task_end(f.thread_b);
        longest = std::max(longest, f.clock.now() - frame);
        f.clock.advance(frame + 33ms - f.clock.now());
    }
    CHECK(longest > 2ms);
    CHECK(longest < 5ms);
    CHECK(f.stats(1).missed == 0);
}

TEST_CASE("Runtime ends a hold within one poll when it is switched off", "[runtime][hold]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_a);
    f.wait_a();
    f.clock.on_sleep = [&] { f.rt().set_mode(Mode::kOff); };
    f.launch(f.thread_b, kStreamB);
    CHECK(f.clock.num_sleeps == 1);
    CHECK(f.launch(f.thread_b, kStreamB).task == nullptr);
}

TEST_CASE("Runtime adds at most the instance's bound by holding, and counts that it opened",
          "[runtime][hold]") {
    Fixture f;
    SECTION("that the config says") {
        f.resolved.config.scheduler.hold_max_per_instance = 2ms;
    }
    SECTION("in deadlines that the config says") {
        f.resolved.config.scheduler.hold_max_deadlines = 0.02;
    }
    f.begin(f.thread_a, "tight");
    f.begin(f.thread_b, "loose");
    f.clock.on_sleep = [&] {  // keeps launching: blocks forever
        f.driver.execute_marks(99);
        f.launch(f.thread_a);
    };
    f.launch(f.thread_a);
    f.launch(f.thread_b, kStreamB);
    CHECK(f.stats(1).held_ns == std::chrono::nanoseconds(2ms).count());
    CHECK(f.stats(1).holds_opened == 1);
    const int sleeps = f.clock.num_sleeps;
    f.launch(f.thread_b, kStreamB);  // and from then on at once
    CHECK(f.clock.num_sleeps == sleeps);
}

TEST_CASE("Runtime forgets a segment when the program has waited for its stream", "[runtime]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_a);
    f.wait_a();
    CHECK_FALSE(f.begin_wait(f.thread_a, kStreamB).for_all);
    f.wait(f.thread_a, kStreamA);
    f.launch(f.thread_b, kStreamB);
    CHECK(f.clock.num_sleeps == 0);
}

TEST_CASE("Runtime counts latency and misses from arrival to the end of the last task",
          "[runtime][instances]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    f.clock.advance(19ms);
    f.rt().task_end(f.thread_a);
    f.begin(f.thread_a, "tight");
    f.clock.advance(21ms);
    f.rt().task_end(f.thread_a);
    CHECK(f.stats(0).instances == 2);
    CHECK(f.stats(0).finished == 2);
    CHECK(f.stats(0).missed == 1);
    CHECK(f.stats(0).latency_max_ns == std::chrono::nanoseconds(21ms).count());
}

TEST_CASE("Runtime exits a chain early only when asked to and only when it cannot be met",
          "[runtime][early_exit]") {
    Fixture f;
    f.resolved.config.chains[0].on_late = config::OnLate::kExit;
    // 2 ms of GPU and 1 ms of CPU time in 20 ms: the point of no return is 17 ms after arrival.
    const auto verdict_after = [&](const char* chain, std::chrono::nanoseconds delay) {
        const auto instance = f.rt().arrival(nullptr, chain, f.clock.now() - delay);
        const bool exit_chain = f.rt().task_begin(f.thread_a, instance, "detect");
        f.rt().task_end(f.thread_a);
        return exit_chain;
    };
    CHECK_FALSE(verdict_after("tight", 17ms));
    CHECK(verdict_after("tight", 17ms + 1ns));
    CHECK_FALSE(verdict_after("loose", 200ms));
    CHECK(f.stats(0).exited == 1);
    CHECK(f.stats(0).missed == 1);
    f.rt().set_mode(Mode::kObserve);
    CHECK_FALSE(verdict_after("tight", 100ms));
}

TEST_CASE("Runtime in observe mode counts and changes nothing", "[runtime][observe]") {
    Fixture f;
    f.resolved.config.mode = Mode::kObserve;
    f.begin(f.thread_a, "tight");
    f.begin(f.thread_b, "loose");
    for (int i = 0; i < 20; ++i) {
        CHECK_FALSE(f.launch(f.thread_a).set_priority);
        CHECK_FALSE(f.launch(f.thread_b, kStreamB).set_priority);
    }
    f.wait(f.thread_a, kStreamA);
    f.rt().task_end(f.thread_a);
    CHECK(f.driver.marks.empty());
    CHECK(f.clock.num_sleeps == 0);
    CHECK(f.stats(0).launches == 20);
    CHECK(f.stats(0).finished == 1);
}

TEST_CASE("Runtime takes a thread's launches for the task whose pattern fits its name",
          "[runtime][threads]") {
    Fixture f;
    char old_name[16] = {};
    prctl(PR_GET_NAME, old_name);
    prctl(PR_SET_NAME, "th_loose");
    CHECK(f.launch(f.thread_a).task != nullptr);
    CHECK(f.stats(1).instances == 1);
    f.wait(f.thread_a, kStreamA);
    CHECK(f.stats(1).finished == 1);
    prctl(PR_SET_NAME, "renamed");  // a pool's thread: read again after each wait
    CHECK(f.launch(f.thread_a).task == nullptr);
    prctl(PR_SET_NAME, old_name);
}

TEST_CASE("Runtime ends an instance that nobody is seen to wait for", "[runtime][threads]") {
    Fixture f;
    char old_name[16] = {};
    prctl(PR_GET_NAME, old_name);
    prctl(PR_SET_NAME, "th_loose");
    f.launch(f.thread_a);
    f.clock.advance(200ms);
    f.launch(f.thread_a);
    CHECK(f.stats(1).instances == 1);
    f.clock.advance(1ms);
    f.launch(f.thread_a);
    CHECK(f.stats(1).instances == 2);
    CHECK(f.stats(1).finished == 1);
    prctl(PR_SET_NAME, old_name);
}

TEST_CASE("Runtime lets hints take over a thread that its name had matched", "[runtime][threads]") {
    Fixture f;
    char old_name[16] = {};
    prctl(PR_GET_NAME, old_name);
    prctl(PR_SET_NAME, "th_loose");
    f.launch(f.thread_a);  // a warm-up, never waited for
    f.begin(f.thread_a, "loose");
    CHECK(f.launch(f.thread_a).scheduled);
    f.rt().task_end(f.thread_a);
    CHECK(f.launch(f.thread_a).task == nullptr);
    prctl(PR_SET_NAME, old_name);
}

TEST_CASE("Runtime counts frames that never come to their end as missed", "[runtime][instances]") {
    Fixture f;
    f.rt().arrival(nullptr, "tight", f.clock.now());
    f.begin(f.thread_a, "loose");
    f.begin(f.thread_b, "loose");  // its task is taken: not scheduled, but counted
    f.clock.advance(50ms);
    f.rt().task_end(f.thread_b);
    CHECK(f.stats(0).missed == 1);
    CHECK(f.stats(0).finished == 0);
    CHECK(f.stats(1).finished == 1);
    CHECK(f.stats(1).missed == 0);
    CHECK(f.stats(0).missed == 1);  // once
}

TEST_CASE("Runtime schedules the first device that it sees and leaves the others alone",
          "[runtime]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    CHECK(f.launch(f.thread_a).scheduled);
    f.driver.context = reinterpret_cast<CUcontext>(0x43);
    f.driver.device = 1;
    f.begin(f.thread_b, "loose");
    CHECK_FALSE(f.launch(f.thread_b, kStreamB).scheduled);
}

TEST_CASE("Runtime does not schedule a second thread in a task that is taken",
          "[runtime][threads]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    f.begin(f.thread_b, "tight");
    CHECK(f.launch(f.thread_a).task != nullptr);
    CHECK(f.launch(f.thread_b).task == nullptr);
    f.rt().thread_exit(f.thread_a);
    f.rt().task_end(f.thread_b);
    f.begin(f.thread_b, "tight");
    CHECK(f.launch(f.thread_b).task != nullptr);
}

TEST_CASE("Runtime leaves launches untouched in a context that gets no marks", "[runtime]") {
    Fixture f;
    f.driver.set_up_result = CUDA_ERROR_OUT_OF_MEMORY;
    f.begin(f.thread_a, "tight");
    const Grant g = f.launch(f.thread_a);
    CHECK_FALSE(g.scheduled);
    CHECK_FALSE(g.set_priority);
    CHECK(f.driver.marks.empty());
    f.driver.set_up_result = CUDA_SUCCESS;
    f.driver.context = nullptr;
    CHECK_FALSE(f.launch(f.thread_a).scheduled);
}

TEST_CASE("Runtime keeps its progress apart when a task moves to another context", "[runtime]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 3; ++i) f.launch(f.thread_a);
    f.wait_a();
    f.driver.execute_marks(9);
    f.wait(f.thread_a, kStreamA);
    f.driver.context = reinterpret_cast<CUcontext>(0x43);
    for (int i = 0; i < 10; ++i) f.launch(f.thread_a);
    CHECK(f.clock.num_sleeps == 0);
    f.clock.on_sleep = [&] { f.driver.execute_marks(1); };
    for (int i = 0; i < 2; ++i) f.launch(f.thread_a);
    CHECK(f.clock.num_sleeps == 1);  // run-ahead is counted from the new context's marks
}

TEST_CASE("Runtime asks for a kernel's name once until a module is unloaded", "[runtime]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 5; ++i) f.launch(f.thread_a);
    CHECK(f.driver.num_name_queries == 1);
    f.rt().forget_names();
    f.launch(f.thread_a);
    CHECK(f.driver.num_name_queries == 2);
}

TEST_CASE("Runtime asks for no kernel's name while its module is unloaded", "[runtime]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    {
        const identity::NameGate::Unloading unloading(&f.rt().kernels().gate());
        for (int i = 0; i < 3; ++i) f.launch(f.thread_a);
        CHECK(f.driver.num_name_queries == 0);
    }
    f.launch(f.thread_a);
    CHECK(f.driver.num_name_queries == 1);
}

TEST_CASE("Module is unloaded after the names that are being read", "[runtime]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    std::atomic<bool> begins{false}, unloads{false};
    std::thread unloader;
    f.driver.on_name_query = [&] {
        unloader = std::thread([&] {
            begins = true;
            const identity::NameGate::Unloading unloading(&f.rt().kernels().gate());
            unloads = true;
        });
        while (!begins) std::this_thread::yield();
        for (int i = 0; i < 100; ++i) std::this_thread::yield();
        CHECK_FALSE(unloads);
    };
    f.launch(f.thread_a);
    unloader.join();
    CHECK(unloads);
}

TEST_CASE("Runtime ignores tokens and names that it does not know", "[runtime][instances]") {
    Fixture f;
    CHECK(f.rt().arrival(nullptr, "no such chain", 1s) == 0);
    CHECK_FALSE(f.rt().task_begin(f.thread_a, 12345, "detect"));
    const auto instance = f.rt().arrival(nullptr, "tight", f.clock.now());
    CHECK_FALSE(f.rt().task_begin(f.thread_a, instance, "no such task"));
    CHECK(f.launch(f.thread_a).task == nullptr);
    f.rt().task_end(f.thread_a);
}

TEST_CASE("Runtime adds no mark to one that is under way when it paces a task",
          "[runtime][marks]") {
    Fixture f;
    f.resolved.config.scheduler.run_ahead = 650us;
    f.resolved.config.scheduler.mark_every = 400us;  // alone, too: at most half of the run-ahead
    f.begin(f.thread_a, "tight");
    std::vector<std::size_t> marks_in_wait;
    f.clock.on_sleep = [&] {
        marks_in_wait.push_back(f.driver.marks.size());
        f.driver.execute_marks(1);
    };
    for (int i = 0; i < 8; ++i) f.launch(f.thread_a);
    // Behind the fourth kernel; 700 us are too much, with that mark under way. Without it, behind
    // what is launched.
    CHECK(marks_in_wait == std::vector<std::size_t>{1});
    CHECK(f.stats(0).marks == 1);
    f.launch(f.thread_a);  // the next one is due
    CHECK(f.stats(0).marks == 2);
}

TEST_CASE("Runtime says in every slot whose it is", "[runtime]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    CHECK(f.launch(f.thread_a).task->slot->owner == static_cast<std::uint32_t>(getpid()));
}
