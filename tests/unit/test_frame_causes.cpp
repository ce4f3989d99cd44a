// SPDX-License-Identifier: Apache-2.0
//
// Causes that are injected into frames in virtual time, as the whole runtime finds them.
#include "host/runtime/frame_causes.h"

#include <algorithm>
#include <chrono>
#include <random>

#include "tests/support/runtime_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using abi::MissCause;

namespace {

/// What a frame of one GPU segment takes.
struct Takes {
    nanoseconds to_begin{100us};  ///< from its arrival to its task's begin
    nanoseconds cpu{1ms};
    nanoseconds gpu{2ms};
    nanoseconds tail{200us};  ///< behind its wait
};

struct Fixture : RuntimeFixture {
    Fixture() {
        close_segments();
        resolved.config.scheduler.guard = false;  // with so many misses it would observe some
    }

    void launch_all(ThreadState& thread, CUstream stream, int count = 20) {
        for (int i = 0; i < count; ++i) launch(thread, stream);
    }
    void wait_for(ThreadState& thread, CUstream stream, nanoseconds time) {
        const runtime::Wait wait = begin_wait(thread, stream);
        clock.advance(time);
        driver.execute_marks(static_cast<int>(driver.marks.size()));
        rt().waits().after(thread, wait, true);
    }
    void frame(const Takes& takes, const char* chain = "tight") {
        begin(thread_a, chain, takes.to_begin);
        clock.advance(takes.cpu);
        launch_all(thread_a, kStreamA);
        wait_for(thread_a, kStreamA, takes.gpu);
        clock.advance(takes.tail);
        rt().frames().task_end(thread_a);
        clock.advance(100ms);
    }
    void usual_frames(int count = 5) {
        for (int i = 0; i < count; ++i) frame({});
    }
    /// Of the chain's last frame.
    MissCause cause(std::size_t chain = 0) {
        const abi::ChainStatus& status = rt().status().chain(chain);
        return MissCause{status.ring[(status.frames - 1) % abi::kFrameRing].cause.load()};
    }
    int behind(std::size_t chain = 0) {
        const abi::ChainStatus& status = rt().status().chain(chain);
        return status.ring[(status.frames - 1) % abi::kFrameRing].behind.load();
    }
    abi::TaskState page_state(int task) { return rt().status().akb().tasks[task].state; }
    std::vector<observe::CauseCount> counted(std::size_t chain) {
        return rt().report().statistics().at(chain)->causes;
    }
};

}  // namespace

TEST_CASE("Frame in time has no cause, and none is counted", "[runtime][causes]") {
    Fixture f;
    f.usual_frames();
    CHECK(f.cause() == MissCause::kNone);
    CHECK(f.counted(0).empty());
    CHECK(f.rt().status().chain(0).last_miss == 0);
}

TEST_CASE("Causes within a frame are found among noise in 95 of 100 frames", "[runtime][causes]") {
    const std::uint32_t seed = std::random_device()();
    INFO("seed " << seed);
    std::mt19937 random(seed);
    const auto up_to = [&](nanoseconds most) {
        return nanoseconds(
            static_cast<std::int64_t>(random() % static_cast<unsigned long>(most.count())));
    };
    const auto injected =
        GENERATE(MissCause::kArrivedLate, MissCause::kCpuLonger, MissCause::kGpuLonger);
    Fixture f;
    int right = 0;
    constexpr int kFrames = 100;
    for (int i = 0; i < kFrames; ++i) {
        for (int j = 0; j < 3; ++j) {  // as they mostly are
            f.frame({100us + up_to(500us), 1ms + up_to(1ms), 2ms + up_to(1ms), up_to(500us)});
            REQUIRE(f.cause() == MissCause::kNone);
        }
        Takes takes{100us + up_to(500us), 1ms + up_to(1ms), 2ms + up_to(1ms), up_to(500us)};
        const nanoseconds more = 18ms + up_to(20ms);
        if (injected == MissCause::kArrivedLate) takes.to_begin += more;
        if (injected == MissCause::kCpuLonger) (i % 2 == 0 ? takes.cpu : takes.tail) += more;
        if (injected == MissCause::kGpuLonger) takes.gpu += more;
        f.frame(takes);
        right += f.cause() == injected;
    }
    INFO(observe::to_word(injected));
    CHECK(right >= 95);
    const auto counted = f.counted(0);
    REQUIRE_FALSE(counted.empty());
    CHECK(counted[0].cause == injected);
    CHECK(counted[0].count == static_cast<std::uint64_t>(right));
    CHECK(f.stats(0).frames.missed == kFrames);
}

TEST_CASE("Without a profile, longer is what is longer than usual", "[runtime][causes]") {
    Fixture f;
    f.resolved.profile.reset();
    f.usual_frames(10);
    f.frame({.gpu = 25ms});
    CHECK(f.cause() == MissCause::kGpuLonger);
    f.usual_frames(3);
    f.frame({.cpu = 25ms});
    CHECK(f.cause() == MissCause::kCpuLonger);
}

TEST_CASE("Frame that was held behind another chain names it", "[runtime][causes]") {
    Fixture f;
    f.resolved.config.chains[1].deadline = 22ms;
    f.begin(f.thread_a, "tight");
    f.begin(f.thread_b, "loose");
    f.clock.advance(1ms);
    const nanoseconds begun = f.clock.now();
    f.clock.on_sleep = [&] {  // keeps the GPU
        f.driver.execute_marks(99);
        if (f.clock.now() - begun < 12ms)
            f.launch(f.thread_a);
        else if (f.page_state(0) != abi::TaskState::kCpu)
            f.wait_for(f.thread_a, kStreamA, 0ms);
    };
    f.launch(f.thread_a);
    f.launch(f.thread_b, kStreamB);
    f.clock.on_sleep = {};
    f.wait_for(f.thread_b, kStreamB, 10ms);  // longer than it should, but not by so much
    f.rt().frames().task_end(f.thread_b);
    INFO("held " << f.stats(1).tasks.held_ns);
    CHECK(f.stats(1).frames.missed == 1);
    CHECK(f.cause(1) == MissCause::kHeld);
    CHECK(f.behind(1) == 0);
    const auto counted = f.counted(1);
    REQUIRE(counted.size() == 1);
    CHECK(counted[0].behind == "tight");
    const abi::ChainStatus& status = f.rt().status().chain(1);
    CHECK(status.causes[static_cast<std::size_t>(MissCause::kHeld)] == 1);
    CHECK(status.last_miss == 1);
    CHECK(status.last_behind == 0);
    CHECK(status.last_late_us > 0);
}

TEST_CASE("Kernel of a less urgent chain that was on the GPU before is named in 95 of 100 frames",
          "[runtime][causes]") {
    const std::uint32_t seed = std::random_device()();
    INFO("seed " << seed);
    std::mt19937 random(seed);
    const auto up_to_us = [&](unsigned most) { return nanoseconds(1'000 * (random() % most)); };
    Fixture f;
    // A co-runner's kernels of 20 ms.
    f.resolved.profile->chains[1].tasks[0] = profile_of("detect", 2, 20ms, 1.0);
    f.resolved.profile->chains[1].tasks[0].segments = {{1ms, 2, 2, 2, "stream"}};
    int right = 0;
    constexpr int kFrames = 100;
    for (int i = 0; i < kFrames; ++i) {
        f.begin(f.thread_b, "loose");
        f.clock.advance(1ms);
        f.launch_all(f.thread_b, kStreamB, 2);
        const nanoseconds before = 100us + up_to_us(1500);
        f.clock.advance(before);

        f.begin(f.thread_a, "tight", up_to_us(300));
        const nanoseconds cpu = 1ms + up_to_us(500);
        f.clock.advance(cpu);
        f.launch_all(f.thread_a, kStreamA);
        // What was left of the kernel, and its own 2 ms.
        f.wait_for(f.thread_a, kStreamA, 20ms - before - cpu + 2ms + up_to_us(500));
        f.rt().frames().task_end(f.thread_a);
        right += f.cause(0) == MissCause::kKernelInFront && f.behind(0) == 1;

        f.wait_for(f.thread_b, kStreamB, 20ms);
        f.rt().frames().task_end(f.thread_b);
        f.clock.advance(100ms);
    }
    CHECK(right >= 95);
    CHECK(f.stats(0).frames.missed == kFrames);
}

TEST_CASE("What a segment takes beyond its kernels by the profile is not longer",
          "[runtime][causes]") {
    Fixture f;
    f.resolved.profile->chains[0].tasks[0].segments[0].latency = 15ms;  // copies, say
    f.usual_frames();
    f.frame({.cpu = 7ms, .gpu = 16ms});
    CHECK(f.cause() == MissCause::kCpuLonger);
    f.frame({.gpu = 30ms});
    CHECK(f.cause() == MissCause::kGpuLonger);
}

TEST_CASE("More urgent work that was on the GPU meanwhile is named", "[runtime][causes]") {
    Fixture f;
    f.resolved.profile->chains[0].tasks[0] = profile_of("detect", 20, 4ms, 1.0);
    f.resolved.profile->chains[0].tasks[0].segments = {{1ms, 20, 20, 20, "stream"}};
    f.resolved.config.chains[0].deadline = 90ms;
    f.resolved.config.scheduler.admission = config::Admission::kNone;  // nothing is held
    f.begin(f.thread_b, "loose");
    f.clock.advance(1ms);
    f.launch(f.thread_b, kStreamB);
    f.begin(f.thread_a, "tight");
    f.clock.advance(1ms);
    f.launch_all(f.thread_a, kStreamA);
    f.launch_all(f.thread_b, kStreamB, 19);
    f.wait_for(f.thread_a, kStreamA, 81ms);
    f.rt().frames().task_end(f.thread_a);
    f.wait_for(f.thread_b, kStreamB, 20ms);
    f.rt().frames().task_end(f.thread_b);
    CHECK(f.stats(1).frames.missed == 1);
    CHECK(f.cause(1) == MissCause::kShared);
    CHECK(f.behind(1) == 0);
}

TEST_CASE("Late frame of which UrgenGo did not schedule a part is late for that",
          "[runtime][causes]") {
    Fixture f;
    SECTION("it only observes") {
        f.resolved.config.mode = config::Mode::kObserve;
    }
    SECTION("its config asks for no scheduling") {
        f.resolved.config.scheduler.admission = config::Admission::kNone;
        f.resolved.config.scheduler.binding = config::Binding::kNone;
    }
    SECTION("it was switched off meanwhile, and on again") {
        f.clock.on_sleep = {};
        f.usual_frames(1);
        f.begin(f.thread_a, "tight");
        f.launch_all(f.thread_a, kStreamA, 3);
        std::uint32_t word = 0;
        for (const auto command : {abi::ControlCommand::kOff, abi::ControlCommand::kOn})
            f.rt().steering().obey(word = abi::next_control_word(word, command));
        f.clock.advance(30ms);
        f.rt().frames().task_end(f.thread_a);
        CHECK(f.cause() == MissCause::kOff);
    }
    f.frame({.gpu = 30ms});
    const bool schedules = f.resolved.config.mode == config::Mode::kEnforce &&
                           f.resolved.config.scheduler.binding != config::Binding::kNone;
    CHECK(f.cause() == (schedules ? MissCause::kGpuLonger : MissCause::kOff));
}

TEST_CASE("Longer kernels are told with their factor", "[runtime][causes]") {
    Fixture f;
    f.usual_frames();
    f.frame({.gpu = 30ms});
    CHECK(f.cause() == MissCause::kGpuLonger);
    const std::uint16_t detail = f.rt().status().chain(0).last_detail;
    CHECK(observe::times_as_long(MissCause::kGpuLonger, detail) == Approx(15.5).margin(1));
}

TEST_CASE(
    "Thread that sleeps longer than profiled waits for something outside, and one that "
    "loses its core does not",
    "[runtime][causes]") {
    Fixture f;
    f.usual_frames();
    const auto frame = [&](auto before, auto between, auto behind) {
        f.begin(f.thread_a, "tight", 100us);
        f.clock.advance(1ms);
        before();
        f.launch_all(f.thread_a, kStreamA, 10);
        between();
        f.launch_all(f.thread_a, kStreamA, 10);
        f.wait_for(f.thread_a, kStreamA, 2ms);
        f.clock.advance(200us);
        behind();
        f.rt().frames().task_end(f.thread_a);
        f.clock.advance(100ms);
        return f.cause();
    };
    const auto nothing = [] {};
    const auto sleeps = [&] { f.clock.sleep_outside(30ms); };
    const auto loses_core = [&] { f.clock.lose_core(30ms); };
    const auto computes = [&] { f.clock.advance(30ms); };
    CHECK(frame(sleeps, nothing, nothing) == MissCause::kOutside);
    CHECK(frame(loses_core, nothing, nothing) == MissCause::kCpuLonger);
    CHECK(frame(computes, nothing, nothing) == MissCause::kCpuLonger);
    CHECK(frame(nothing, nothing, sleeps) == MissCause::kOutside);
    CHECK(frame(nothing, nothing, computes) == MissCause::kCpuLonger);
    // Most of it counts.
    CHECK(frame(
              [&] {
                  f.clock.advance(10ms);
                  f.clock.sleep_outside(20ms);
              },
              nothing, nothing) == MissCause::kOutside);
    CHECK(frame(nothing, nothing, nothing) == MissCause::kNone);
}

TEST_CASE("Frame that was ended early was given up", "[runtime][causes]") {
    Fixture f;
    f.resolved.config.chains[0].on_late = config::OnLate::kExit;
    const auto token = f.rt().frames().arrival(nullptr, "tight", f.clock.now() - 19ms);
    CHECK(f.rt().frames().task_begin(f.thread_a, token, "detect"));
    CHECK(f.cause() == MissCause::kEndedEarly);
    // 2 ms of the GPU and 1 ms of the CPU in the millisecond that is left.
    CHECK(f.rt().status().chain(0).last_detail == 200);
}

TEST_CASE("Frames that never come to their end have a cause, too: causes add up to misses",
          "[runtime][causes]") {
    Fixture f;
    f.usual_frames();
    f.frame({.gpu = 30ms});
    const auto dropped = GENERATE(0, 1, 300);  // the last ones push out others
    for (int i = 0; i < dropped; ++i) f.rt().frames().arrival(nullptr, "tight", f.clock.now());
    f.clock.advance(30ms);
    f.frame({.cpu = 30ms});
    const std::uint64_t missed = f.stats(0).frames.missed;
    CHECK(missed == static_cast<std::uint64_t>(2 + dropped));
    std::uint64_t counted = 0;
    for (const auto& cause : f.counted(0)) counted += cause.count;
    CHECK(counted == missed);
    const abi::ChainStatus& status = f.rt().status().chain(0);
    CHECK(status.missed == missed);
    CHECK(status.misses_in_a_row == f.stats(0).frames.misses_in_a_row);
    CHECK(status.causes[static_cast<std::size_t>(MissCause::kDropped)] ==
          static_cast<std::uint64_t>(dropped));
    CHECK(status.frames == 7);
}

TEST_CASE("Time between two tasks of a chain counts for the CPU, by what is usual",
          "[runtime][causes]") {
    Fixture f;
    f.resolved.config.chains[0].tasks.push_back({"track", "th_track"});
    f.resolved.config.chains[0].deadline = 20ms;
    const auto run_frame = [&](nanoseconds between) {
        const auto token = f.rt().frames().arrival(nullptr, "tight", f.clock.now());
        f.rt().frames().task_begin(f.thread_a, token, "detect");
        f.clock.advance(1ms);
        f.launch_all(f.thread_a, kStreamA);
        f.wait_for(f.thread_a, kStreamA, 2ms);
        f.rt().frames().task_end(f.thread_a);
        f.clock.advance(between);
        f.rt().frames().task_begin(f.thread_b, token, "track");
        f.clock.advance(1ms);
        f.launch(f.thread_b, kStreamB);
        f.wait_for(f.thread_b, kStreamB, 1ms);
        f.rt().frames().task_end(f.thread_b);
        f.clock.advance(100ms);
    };
    for (int i = 0; i < 10; ++i) run_frame(2ms);
    CHECK(f.cause() == MissCause::kNone);
    run_frame(20ms);
    CHECK(f.cause() == MissCause::kCpuLonger);
}

TEST_CASE("Frames whose task is at the frame before began late, however usual that becomes",
          "[runtime][causes]") {
    Fixture f;
    f.usual_frames();
    for (int i = 0; i < 40; ++i) {
        f.begin(f.thread_a, "tight", i == 0 ? 100us : 30ms);
        f.clock.advance(1ms);
        f.launch_all(f.thread_a, kStreamA);
        f.wait_for(f.thread_a, kStreamA, 40ms);  // longer than the next frame has lain there
        f.rt().frames().task_end(f.thread_a);
    }
    f.begin(f.thread_a, "tight", 30ms);
    f.clock.advance(1ms);
    f.launch_all(f.thread_a, kStreamA);
    f.wait_for(f.thread_a, kStreamA, 2ms);
    f.rt().frames().task_end(f.thread_a);
    CHECK(f.cause() == MissCause::kArrivedLate);
}
