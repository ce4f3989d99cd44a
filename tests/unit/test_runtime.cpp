// SPDX-License-Identifier: Apache-2.0
//
// What the runtime acts on and what it leaves alone, in virtual time, against a driver that
// executes marks when the test says so.
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
    f.rt().frames().task_end(f.thread_a);
    CHECK(f.driver.marks.empty());
    CHECK(f.clock.num_sleeps == 0);
    CHECK(f.stats(0).tasks.launches == 20);
    CHECK(f.stats(0).frames.finished == 1);
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
    f.rt().contexts().forget_names();
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

TEST_CASE("Runtime says in every slot whose it is", "[runtime]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    CHECK(f.launch(f.thread_a).task->slot->owner == static_cast<std::uint32_t>(getpid()));
}

TEST_CASE("Runtime changes nothing for a chain that is only observed", "[runtime][observe]") {
    Fixture f;
    f.resolved.config.chains[1].mode = Mode::kObserve;
    f.begin(f.thread_a, "tight");
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_a);
    CHECK_FALSE(f.launch(f.thread_b, kStreamB).scheduled);
    CHECK(f.clock.num_sleeps == 0);
    CHECK(f.launch(f.thread_a).scheduled);
}
