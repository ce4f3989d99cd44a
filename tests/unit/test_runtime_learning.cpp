// SPDX-License-Identifier: Apache-2.0
//
// Kernels' times learned while a task runs, in virtual time, on a GPU that runs one kernel after
// the other.
#include <cmath>
#include <deque>

#include "tests/support/runtime_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using std::chrono::nanoseconds;

namespace {

struct RuntimeLearningTest : RuntimeFixture {
    RuntimeLearningTest() {
        resolved.config.scheduler.progress.learn = true;
        close_segments();
        clock.on_sleep = [this] { run_gpu(); };
    }

    /// Runs one instance of `tight`: 20 kernels, each of which takes `truth`.
    /// @returns the estimate with which the tenth was launched
    nanoseconds run(nanoseconds truth) {
        nanoseconds estimate{0};
        begin(thread_a, "tight");
        for (int i = 0; i < 20; ++i) {
            clock.advance(3us);
            run_gpu();
            const Launch l{kConv, 100, 256, kStreamA};
            if (rt().planned().goes(thread_a, l)) {
                free = std::max(free, clock.now() + 3us) + truth;
                runtime::went_as_planned(thread_a.line);
                ++num_as_planned;
                continue;
            }
            const Grant grant = rt().launches().before(thread_a, l);
            if (i == 10) estimate = grant.estimate;
            queue_marks();
            free = std::max(free, clock.now() + 3us) + truth;
            rt().launches().after(thread_a, l, grant, true);
            queue_marks();
        }
        const runtime::Wait wait = begin_wait(thread_a, kStreamA);
        queue_marks();
        clock.advance(std::max(free - clock.now(), nanoseconds{0}) + 2us);
        run_gpu();
        rt().waits().after(thread_a, wait, true);
        rt().frames().task_end(thread_a);
        clock.advance(5ms);
        return estimate;
    }
    void queue_marks() {
        while (times.size() < driver.marks.size()) {
            times.push_back(free = std::max(free, clock.now() + 3us));
            free += 1'700ns;
        }
    }
    void run_gpu() {
        for (; !times.empty() && times.front() <= clock.now(); times.pop_front()) {
            driver.gpu_time_ns = static_cast<std::uint64_t>((times.front() + 4s).count());
            driver.execute_marks(1);
        }
    }

    int num_as_planned = 0;
    nanoseconds free{0};            ///< when the GPU has done all that was launched
    std::deque<nanoseconds> times;  ///< of driver.marks
};

bool is_about(nanoseconds a, nanoseconds b, double share = 0.1) {
    return std::abs(static_cast<double>((a - b).count())) < share * static_cast<double>(b.count());
}

}  // namespace

TEST_CASE("A task without a profile is known after a few instances", "[runtime][learning]") {
    RuntimeLearningTest f;
    f.resolved.profile.reset();
    CHECK(f.run(100us) == 20us);
    nanoseconds estimate{0};
    for (int i = 0; i < 6; ++i) estimate = f.run(100us);
    CAPTURE(estimate.count());
    CHECK(is_about(estimate, 100us));
    for (int i = 0; i < 12; ++i) f.run(100us);
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    const auto remaining = f.rt().progress().position("tight", "detect")->remaining;
    CAPTURE(remaining.count());
    CHECK(is_about(remaining, 2ms, 0.15));
}

TEST_CASE("A profile that is off by two is put right", "[runtime][learning]") {
    RuntimeLearningTest f;
    nanoseconds estimate{0};
    const nanoseconds truth = GENERATE(50us, 200us);
    for (int i = 0; i < 8; ++i) estimate = f.run(truth);
    CAPTURE(estimate.count());
    CHECK(is_about(estimate, truth, 0.15));
}

TEST_CASE("What is learned of one task counts in those before it", "[runtime][learning]") {
    RuntimeLearningTest f;
    REQUIRE(f.resolved.config.chains[0].name == "tight");
    config::Task before = f.resolved.config.chains[0].tasks[0];
    const std::string later = before.name;
    before.name = "before";
    before.thread_glob = "before_*";
    auto& tasks = f.resolved.config.chains[0].tasks;
    tasks.insert(tasks.begin(), before);
    f.resolved.config.chains[0].on_late = config::OnLate::kExit;
    // With so much time left before the chain's first task, is it too late for the later one?
    const auto is_too_late = [&](nanoseconds left) {
        const auto arrival = f.clock.now() - 20ms + left;
        const bool late = f.rt().frames().task_begin(
            f.thread_b, f.rt().frames().arrival(nullptr, "tight", arrival), "before");
        if (!late) f.rt().frames().task_end(f.thread_b);
        return late;
    };
    const nanoseconds cpu = 1ms;
    CHECK_FALSE(is_too_late(cpu + 2'100us));
    CHECK(is_too_late(cpu + 1'900us));
    for (int i = 0; i < 16; ++i) f.run(200us);
    // Of its CPU segment it was learned that it takes no time.
    CHECK_FALSE(is_too_late(cpu + 4'600us));
    CHECK(is_too_late(3'400us));
}

TEST_CASE("Launches of a task that is learned are estimated by what was learned",
          "[runtime][learning]") {
    RuntimeLearningTest f;
    // All of a span is estimated in one way, or its shares are wrong for ever.
    for (int i = 0; i < 16; ++i) f.run(50us);
    CHECK(f.num_as_planned == 0);
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    const auto remaining = f.rt().progress().position("tight", "detect")->remaining;
    CAPTURE(remaining.count());
    CHECK(is_about(remaining, 1ms, 0.15));
}

TEST_CASE("Nothing is learned unless it is asked for", "[runtime][learning]") {
    RuntimeLearningTest f;
    f.resolved.config.scheduler.progress.learn = false;
    f.resolved.config.scheduler.progress.mark_every = 250us;  // asked about: every fifth
    for (int i = 0; i < 8; ++i) CHECK(f.run(200us) == 100us);
}

TEST_CASE("Time beside others is not the task's own", "[runtime][learning]") {
    RuntimeLearningTest f;
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_b, kStreamB);
    f.queue_marks();
    for (int i = 0; i < 8; ++i) {
        const nanoseconds estimate = f.run(200us);
        CAPTURE(estimate.count());
        CHECK(is_about(estimate, 100us, 0.01));
    }
}
