// SPDX-License-Identifier: Apache-2.0
//
// Hundreds of tasks, threads that serve several chains in turn, and jumps out of a hold.
#include <csetjmp>

#include "host/model/task_set.h"
#include "tests/support/runtime_fixture.h"

namespace urgengo::testing {
namespace {

nanoseconds deadline_of(const Grant& grant) {
    return nanoseconds(grant.task->slot->deadline_ns.load());
}

}  // namespace

TEST_CASE("A thread that served a chain long ago does not serve it now", "[runtime][scale]") {
    RuntimeFixture f;  // `tight`: 20 ms, `loose`: 100 ms, periods of 200 ms
    f.begin(f.thread_a, "tight");
    f.rt().frames().task_end(f.thread_a);
    const auto loose_after = [&](std::chrono::nanoseconds since_tight) {
        f.begin(f.thread_b, "tight");  // it has another thread by now
        f.rt().frames().task_end(f.thread_b);
        f.clock.advance(since_tight);
        f.begin(f.thread_a, "loose");
        const nanoseconds ahead = deadline_of(f.launch(f.thread_a)) - f.clock.now();
        f.rt().frames().task_end(f.thread_a);
        return ahead;
    };
    CHECK(loose_after(150ms) == 70ms);  // it may have the next frame of `tight` to do by then
    for (int i = 0; i < 10; ++i) loose_after(200ms);  // no frame comes early
    CHECK(loose_after(200ms) == 100ms);
}

TEST_CASE("All of 256 tasks are ranked and planned for", "[runtime][scale]") {
    RuntimeFixture f;
    f.resolved.config.chains.clear();
    f.resolved.profile->chains.clear();
    constexpr int kTasks = 256;
    for (int i = 0; i < kTasks; ++i) {
        config::Chain chain;
        chain.name = "c" + std::to_string(i);
        chain.period = 200ms;
        chain.deadline = 100ms - i * 100us;  // the last is the most urgent
        chain.tasks = {{"detect", "th"}};
        f.resolved.config.chains.push_back(chain);
        f.resolved.profile->chains.push_back({chain.name, {profile_of("detect", 20, 10us, 1.0)}});
    }
    std::vector<std::unique_ptr<ThreadState>> threads;
    f.clock.on_sleep = [&] { f.rt().steering().set_mode(config::Mode::kObserve); };  // ends a hold
    for (int i = 0; i < kTasks; ++i) {
        f.begin(*threads.emplace_back(std::make_unique<ThreadState>()),
                ("c" + std::to_string(i)).c_str());
        f.rt().steering().set_mode(config::Mode::kEnforce);
        const Grant grant = f.launch(*threads.back());
        REQUIRE(grant.scheduled);
        const sched::Decision& decision = grant.task->decision.decision;
        CHECK(decision.admit);  // it comes before all that are there
        CHECK(decision.rank == 0);
    }
    // The least urgent comes after all the others.
    const Launch l{kConv, 100, 256, kStreamA};
    int held = 0;
    f.clock.on_sleep = [&] {
        ++held;
        f.rt().steering().set_mode(config::Mode::kObserve);
    };
    f.rt().steering().set_mode(config::Mode::kEnforce);
    f.clock.advance(50us);  // the others are at work still
    f.rt().launches().before(*threads.front(), l);
    CHECK(held == 1);
    f.clock.on_sleep = nullptr;
}

TEST_CASE("A thread that has jumped out of a hold is scheduled again", "[runtime][scale]") {
    static std::jmp_buf back;
    RuntimeFixture f;
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    f.begin(f.thread_b, "loose");
    const Launch l{kConv, 100, 256, kStreamB};
    f.clock.on_sleep = [&] { std::longjmp(back, 1); };
    if (setjmp(back) == 0) {
        f.rt().launches().before(f.thread_b, l);
        FAIL("it was not held");
    }
    f.clock.on_sleep = nullptr;
    REQUIRE(f.thread_b.at_task != nullptr);
    REQUIRE(f.thread_b.at_task->taking.held_frame != nullptr);
    CHECK_FALSE(
        f.rt().launches().before(f.thread_b, l).scheduled);  // it keeps the task from itself
    f.rt().jumped_out_of_hold(f.thread_b);
    CHECK(f.thread_b.at_task == nullptr);
    f.rt().frames().task_end(f.thread_a);
    CHECK(f.launch(f.thread_b, kStreamB).scheduled);
    const auto warnings = f.rt().report().warnings();
    CHECK(std::any_of(warnings.begin(), warnings.end(), [](const std::string& line) {
        return line.find("jumped out of a held launch (siglongjmp): 1 times") != line.npos;
    }));
}

}  // namespace urgengo::testing
