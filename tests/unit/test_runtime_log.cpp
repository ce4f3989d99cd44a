// SPDX-License-Identifier: Apache-2.0
//
// What the runtime writes down of launches, of the GPU's clock and of CPU segments, in virtual
// time.
#include "host/model/durations.h"
#include "tests/support/runtime_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using model::kernel_id;
using Fixture = RuntimeFixture;

namespace {

const std::uint64_t kConvId = kernel_id({fnv1a64("conv"), 100, 256});

}  // namespace

TEST_CASE("A task's log has what was launched, and where its marks are", "[runtime][progress]") {
    Fixture f;
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_b, kStreamB);  // somebody who looks
    f.begin(f.thread_a, "tight");
    const model::LaunchLog& log = f.launch(f.thread_a).task->log;
    for (int i = 0; i < 4; ++i) {
        f.clock.advance(10us);
        f.launch(f.thread_a);
    }
    REQUIRE(log.count() == 5);
    for (std::uint32_t n = 0; n < 5; ++n) {
        const model::LoggedLaunch launch = log.at(n);
        CHECK(launch.end == (n + 1) * 100us);
        CHECK(launch.time == 1s + n * 10us);
        CHECK(launch.kernel == kConvId);
        CHECK(launch.position == n);
        CHECK(launch.instance == 1);
    }
    REQUIRE(f.driver.marks.size() == 2);  // behind two kernels each
    CHECK(log.last_mark() == 2);
    CHECK(log.launches_before_mark(1) == 2);
    CHECK(log.mark_time(1) == 1s + 10us);
    CHECK(log.launches_before_mark(2) == 4);
    f.wait(f.thread_a, kStreamA);
    CHECK(log.launches_before_mark(log.last_mark()) == 5);
    CHECK(log.mark_time(3) == 1s + 40us);  // of the mark before the wait
}

TEST_CASE("What is only counted is not in the log", "[runtime][progress]") {
    Fixture f;
    f.resolved.config.mode = config::Mode::kObserve;
    f.begin(f.thread_a, "tight");
    const Grant grant = f.launch(f.thread_a);
    CHECK(grant.task->log.count() == 0);
    f.rt().steering().set_mode(config::Mode::kEnforce);
    f.launch(f.thread_a);
    CHECK(grant.task->log.count() == 0);  // from the next frame on
    f.rt().frames().task_end(f.thread_a);
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    REQUIRE(grant.task->log.count() == 1);
    CHECK(grant.task->log.at(0).position == 0);
}

TEST_CASE("Launches that went as planned are logged by who is asked next",
          "[runtime][progress][as_planned]") {
    Fixture f;
    f.resolved.config.scheduler.progress.mark_every = 250us;  // five kernels, alone
    f.close_segments();
    f.begin(f.thread_a, "tight");
    const Launch launch{kConv, 100, 256, kStreamA};
    const model::LaunchLog& log = f.launch(f.thread_a).task->log;
    f.clock.advance(30us);
    for (int i = 1; i < 5; ++i) REQUIRE(f.launch_as_interposed(f.thread_a, launch));
    CHECK(log.count() == 1);
    f.clock.advance(10us);
    REQUIRE_FALSE(f.launch_as_interposed(f.thread_a, launch));
    REQUIRE(log.count() == 6);
    for (std::uint32_t n = 0; n < 6; ++n) {
        CHECK(log.at(n).end == (n + 1) * 100us);
        CHECK(log.at(n).position == n);
        CHECK(log.at(n).kernel == kConvId);
        CHECK(log.at(n).instance == 1);
    }
    CHECK(log.time(1) == 1s + 10us);  // evenly, in the time that there was
    CHECK(log.time(4) == 1s + 40us);
    CHECK(log.launches_before_mark(log.last_mark()) == 5);  // the mark came first

    f.rt().frames().task_end(f.thread_a);
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    CHECK(log.at(6).position == 0);
    CHECK(log.at(6).instance == 2);
}

TEST_CASE("The GPU's clock is learned from the marks that are seen", "[runtime][progress]") {
    Fixture f;
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_b, kStreamB);  // somebody who looks
    f.begin(f.thread_a, "tight");
    for (int i = 0; i < 4; ++i) f.launch(f.thread_a);
    REQUIRE(f.driver.marks.size() == 2);
    f.driver.gpu_time_ns = 5'000'000'000;
    const auto launched = f.clock.now();
    const auto look = [&] { (void)f.rt().progress().position("tight", "detect"); };

    SECTION("once each, between its launch and when it was seen") {
        f.clock.advance(20us);
        f.driver.execute_marks(1);
        look();
        REQUIRE(f.rt().progress().gpu_clock().restarts() == 1);
        const auto host = f.rt().progress().gpu_clock().to_host(5'000'000'000);
        REQUIRE(host);
        CHECK(host->time - host->error <= launched);
        CHECK(host->time + host->error >= launched + 20us);
        CHECK(host->error < 12us);
        // The same mark, seen by another task much later, says nothing new.
        f.clock.advance(1s);
        f.launch(f.thread_b, kStreamB);
        CHECK(f.rt().progress().gpu_clock().restarts() == 1);
    }
    SECTION("not from a mark whose launch the log has forgotten") {
        model::LaunchLog& log = f.launch(f.thread_a).task->log;
        for (std::uint32_t i = 0; i < abi::kMarkRing; ++i) log.marked(f.clock.now(), 3 + i);
        f.driver.execute_marks(1);
        look();
        CHECK(f.rt().progress().gpu_clock().restarts() == 0);
    }
    SECTION("not from a stream write") {
        f.driver.gpu_time_ns = UG_MARK_NO_TIME;
        f.driver.execute_marks(1);
        look();
        CHECK(f.rt().progress().gpu_clock().restarts() == 0);
    }
    SECTION("not from an event") {
        f.driver.marks.front().line->clock = UG_MARK_CLOCK_HOST;
        f.driver.execute_marks(1);
        look();
        CHECK(f.rt().progress().gpu_clock().restarts() == 0);
    }
}

TEST_CASE("A held launch is logged when it went", "[runtime][progress]") {
    Fixture f;
    f.begin(f.thread_b, "tight");
    f.launch(f.thread_b, kStreamB);
    f.begin(f.thread_a, "loose");
    f.clock.on_sleep = [&] {
        if (f.clock.num_sleeps == 3) f.wait(f.thread_b, kStreamB);
    };
    const Grant grant = f.launch(f.thread_a);
    REQUIRE(f.clock.num_sleeps >= 3);
    CHECK(grant.task->log.time(0) == f.clock.now());
}

TEST_CASE("CPU segments count for as long as they took lately", "[runtime][progress]") {
    Fixture f;
    f.resolved.config.chains[0].on_late = config::OnLate::kExit;
    f.close_segments();
    // With so much time left at its begin, is an instance too late?
    const auto is_too_late = [&](nanoseconds left) {
        const auto arrival = f.clock.now() - 20ms + left;
        return f.rt().frames().task_begin(
            f.thread_a, f.rt().frames().arrival(nullptr, "tight", arrival), "detect");
    };
    REQUIRE(is_too_late(2'900us));  // 1 ms on the CPU, by the profile, and 2 on the GPU
    for (int instance = 0; instance < 60; ++instance) {
        REQUIRE_FALSE(is_too_late(19ms));
        f.clock.advance(4ms);
        for (int i = 0; i < 20; ++i) f.launch(f.thread_a);
        f.wait(f.thread_a, kStreamA);
        f.driver.execute_marks(100);
        f.rt().frames().task_end(f.thread_a);
        f.clock.advance(100ms);
    }
    CHECK(is_too_late(5'900us));
    CHECK_FALSE(is_too_late(6'100us));
}
