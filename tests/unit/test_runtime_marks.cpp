// SPDX-License-Identifier: Apache-2.0
//
// When and where the runtime marks a task's work, in virtual time.
#include "tests/support/runtime_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using Fixture = RuntimeFixture;

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

TEST_CASE("Marks have one thread, and 256 beside long kernels of large blocks",
          "[runtime][marks]") {
    const auto [block_threads, mark_threads] =
        GENERATE(table<std::uint32_t, unsigned>({{256, 1}, {512, 256}}));
    Fixture f;
    f.resolved.profile->chains[1].tasks[0].kernels[0] = {"conv", 200, block_threads, 2ms, 1.0};
    f.begin(f.thread_b, "loose");
    f.launch_as_interposed(f.thread_b, {kConv, 200, block_threads, kStreamB});
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 4; ++i) f.launch(f.thread_a);
    f.wait_a();
    REQUIRE_FALSE(f.driver.marks.empty());
    CHECK(f.driver.marks.back().stream == kStreamA);
    CHECK(f.driver.marks.back().threads == mark_threads);
}

TEST_CASE("Runtime marks a task half as often when it is alone on the GPU", "[runtime][marks]") {
    Fixture f;
    f.resolved.config.scheduler.progress.mark_every = 250us;
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
    CHECK(f.stats(0).tasks.marks_refused == 1);
    CHECK_FALSE(f.launch(f.thread_a).set_priority);
}

TEST_CASE("Runtime marks no stream but the one that the program's call names", "[runtime][marks]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 3; ++i) f.launch(f.thread_a, kStreamA);
    f.driver.marks.clear();
    const auto event = reinterpret_cast<CUevent>(0xe0);
    f.rt().waits().event_recorded(f.thread_a, event, kStreamA, exec::StreamFlavor::kLegacy, false);
    f.rt().work_on_streams().stream_waits(f.thread_a, kStreamB, exec::StreamFlavor::kLegacy, event);
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
            f.rt().launches().after(f.thread_b, dependent,
                                    f.rt().launches().before(f.thread_b, dependent), true);
    };
    launch(3);
    CHECK(f.driver.marks.empty());
    CHECK(f.clock.num_sleeps == 0);
    launch(8);  // but behind one, where others look at it: every 400 us
    CHECK(f.driver.marks.size() == 2);
}

TEST_CASE("Runtime adds no mark to one that is under way when it paces a task",
          "[runtime][marks]") {
    Fixture f;
    f.resolved.config.scheduler.run_ahead.limit = 650us;
    f.resolved.config.scheduler.progress.mark_every =
        400us;  // alone, too: at most half of the run-ahead
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
    CHECK(f.stats(0).tasks.marks == 1);
    f.launch(f.thread_a);  // the next one is due
    CHECK(f.stats(0).tasks.marks == 2);
}

namespace {

/// Three tasks that launch for 1.2 ms of 1.5, slowed down by each other, and whose kernels are
/// short.
struct LaunchBound : Fixture {
    ThreadState thread_c;
    LaunchBound() {
        resolved.config.chains.push_back(resolved.config.chains[1]);
        resolved.config.chains[2].name = "third";
        resolved.config.chains[2].tasks[0].thread_glob = "th_third";
        resolved.profile->chains.push_back({"third", {profile_of("detect", 20, 5us, 0.3)}});
        for (config::Chain& chain : resolved.config.chains) chain.period = chain.deadline = 1500us;
        for (auto& chain : resolved.profile->chains) {
            config::TaskProfile& task = chain.tasks[0];
            task = profile_of("detect", 20, 5us, 0.3);
            for (std::size_t i = 0; i < task.kernels.size(); ++i)
                task.kernels[i].launch_time = static_cast<int>(i) * 40us;
        }
        close_segments();
        resolved.config.scheduler.progress.mark_every = 20us;
        may_skip = false;
    }
    /// A frame of each, side by side. @returns how many marks there were
    std::uint64_t frame() {
        const auto count = [this] {
            return stats(0).tasks.marks + stats(1).tasks.marks + stats(2).tasks.marks;
        };
        const std::uint64_t before = count();
        struct Side {
            ThreadState& thread;
            const char* chain;
            CUstream stream;
        };
        const Side sides[] = {{thread_a, "tight", kStreamA},
                              {thread_b, "loose", kStreamB},
                              {thread_c, "third", reinterpret_cast<CUstream>(0xc0)}};
        for (const Side& side : sides) begin(side.thread, side.chain);
        for (int i = 0; i < 20; ++i) {
            for (const Side& side : sides) {
                launch(side.thread, side.stream);
                clock.advance(20us);
            }
            driver.execute_marks(100);
        }
        for (const Side& side : sides) wait(side.thread, side.stream);
        driver.execute_marks(100);
        for (const Side& side : sides) rt().frames().task_end(side.thread);
        return count() - before;
    }
};

}  // namespace

TEST_CASE("Runtime marks seldom where launching is what all wait for", "[runtime][marks]") {
    LaunchBound f;
    CHECK(f.frame() >= 12);
    for (int i = 0; i < 20; ++i) f.frame();
    CHECK(f.frame() <= 6);
}
