// SPDX-License-Identifier: Apache-2.0
//
// What becomes of frames: latency, misses, early exit, in virtual time.
#include "tests/support/runtime_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using config::Mode;
using Fixture = RuntimeFixture;

TEST_CASE("Runtime counts latency and misses from arrival to the end of the last task",
          "[runtime][instances]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    f.clock.advance(19ms);
    f.rt().frames().task_end(f.thread_a);
    f.begin(f.thread_a, "tight");
    f.clock.advance(21ms);
    f.rt().frames().task_end(f.thread_a);
    CHECK(f.stats(0).frames.instances == 2);
    CHECK(f.stats(0).frames.finished == 2);
    CHECK(f.stats(0).frames.missed == 1);
    CHECK(f.stats(0).frames.latency_max_ns == std::chrono::nanoseconds(21ms).count());
}

TEST_CASE("Runtime exits a chain early only when asked to and only when it cannot be met",
          "[runtime][early_exit]") {
    Fixture f;
    f.resolved.config.chains[0].on_late = config::OnLate::kExit;
    // 2 ms of GPU and 1 ms of CPU time in 20 ms: the point of no return is 17 ms after arrival.
    const auto verdict_after = [&](const char* chain, std::chrono::nanoseconds delay) {
        const auto instance = f.rt().frames().arrival(nullptr, chain, f.clock.now() - delay);
        const bool exit_chain = f.rt().frames().task_begin(f.thread_a, instance, "detect");
        f.rt().frames().task_end(f.thread_a);
        return exit_chain;
    };
    CHECK_FALSE(verdict_after("tight", 17ms));
    CHECK(verdict_after("tight", 17ms + 1ns));
    CHECK_FALSE(verdict_after("loose", 200ms));
    CHECK(f.stats(0).frames.exited == 1);
    CHECK(f.stats(0).frames.missed == 1);
    f.rt().steering().set_mode(Mode::kObserve);
    CHECK_FALSE(verdict_after("tight", 100ms));
}

TEST_CASE("Runtime counts frames that never come to their end as missed", "[runtime][instances]") {
    Fixture f;
    f.rt().frames().arrival(nullptr, "tight", f.clock.now());
    f.begin(f.thread_a, "loose");
    f.begin(f.thread_b, "loose");  // its task is taken: not scheduled, but counted
    f.clock.advance(50ms);
    f.rt().frames().task_end(f.thread_b);
    CHECK(f.stats(0).frames.missed == 1);
    CHECK(f.stats(0).frames.finished == 0);
    CHECK(f.stats(1).frames.finished == 1);
    CHECK(f.stats(1).frames.missed == 0);
    CHECK(f.stats(0).frames.missed == 1);  // once
}

TEST_CASE("Runtime ignores tokens and names that it does not know", "[runtime][instances]") {
    Fixture f;
    CHECK(f.rt().frames().arrival(nullptr, "no such chain", 1s) == 0);
    CHECK_FALSE(f.rt().frames().task_begin(f.thread_a, 12345, "detect"));
    const auto instance = f.rt().frames().arrival(nullptr, "tight", f.clock.now());
    CHECK_FALSE(f.rt().frames().task_begin(f.thread_a, instance, "no such task"));
    CHECK(f.launch(f.thread_a).task == nullptr);
    f.rt().frames().task_end(f.thread_a);
}
