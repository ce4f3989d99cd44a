// SPDX-License-Identifier: Apache-2.0
//
// Wrong estimates that correct themselves, in virtual time.
#include "tests/support/runtime_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using std::chrono::nanoseconds;

namespace {

struct RuntimeEstimatesTest : RuntimeFixture {
    RuntimeEstimatesTest() {
        close_segments();
        clock.on_sleep = [this] { driver.execute_marks(1000); };
    }

    /// An instance of `tight`, which the profile says takes 2 ms, that takes `truth` from its first
    /// launch to the end of the wait for it; launching takes next to nothing.
    void run(nanoseconds truth) {
        begin(thread_a, "tight");
        for (int i = 0; i < 20; ++i) {
            launch(thread_a);
            driver.execute_marks(1000);
        }
        const runtime::Wait wait = begin_wait(thread_a, kStreamA);
        clock.advance(truth);
        driver.execute_marks(1000);
        rt().waits().after(thread_a, wait, true);
        rt().frames().task_end(thread_a);
        clock.advance(200ms);  // a period: no frame comes early
    }
    /// What the task is said to need at its begin.
    model::SlotView at_begin() {
        begin(thread_a, "tight");
        runtime::TaskState& task = *thread_a.task;
        const auto view = model::read_slot(*task.slot, task.line, task.index, clock.now());
        rt().frames().task_end(thread_a);
        clock.advance(200ms);
        return view;
    }
    std::string warnings() {
        std::string all;
        for (const auto& line : rt().report().warnings()) all += line + "\n";
        return all;
    }
};

}  // namespace

TEST_CASE("A profile that is four times too long is corrected after three instances",
          "[runtime][estimates]") {
    RuntimeEstimatesTest f;
    CHECK(f.at_begin().remaining.gpu == 2ms);
    CHECK_FALSE(f.at_begin().is_supported);
    for (int i = 0; i < 3; ++i) f.run(500us);
    const auto view = f.at_begin();
    CHECK(view.remaining.gpu > 490us);
    CHECK(view.remaining.gpu < 520us);
    CHECK(view.laxity > 20ms - 600us - 1ms);  // of CPU time
    CHECK(view.is_supported);
    CHECK(f.warnings().find("task 'detect' of chain 'tight' were 0.25 times") != std::string::npos);
}

TEST_CASE("A profile that is four times too short is corrected where nobody else was",
          "[runtime][estimates]") {
    RuntimeEstimatesTest f;
    for (int i = 0; i < 12; ++i) f.run(8ms);
    CHECK(f.at_begin().remaining.gpu > 7500us);
    CHECK(f.at_begin().remaining.gpu < 8100us);
}

TEST_CASE("A task is not taken for longer because others were there", "[runtime][estimates]") {
    RuntimeEstimatesTest f;
    f.begin(f.thread_b, "loose");
    f.launch(f.thread_b, kStreamB);
    for (int i = 0; i < 12; ++i) {
        f.launch(f.thread_b, kStreamB);
        f.run(8ms);
    }
    CHECK(f.at_begin().remaining.gpu == 2ms);
}

TEST_CASE("A bystander's time is nobody's", "[runtime][estimates]") {
    RuntimeEstimatesTest f;
    std::atomic<bool> launched{true};
    f.rt().watch_bystanders(launched);
    for (int i = 0; i < 12; ++i) {
        launched = true;
        f.run(8ms);
    }
    CHECK(f.at_begin().remaining.gpu == 2ms);
}

TEST_CASE("Beside a busy bystander nobody is held", "[runtime][bystanders]") {
    RuntimeEstimatesTest f;
    std::atomic<bool> launched{false};
    f.rt().watch_bystanders(launched);
    const auto holds_of_loose = [&] {
        f.begin(f.thread_a, "tight");
        f.launch(f.thread_a);
        f.begin(f.thread_b, "loose");
        f.launch(f.thread_b, kStreamB);
        const auto holds = f.stats(1).tasks.holds.load();
        f.driver.execute_marks(1000);
        f.rt().frames().task_end(f.thread_b);
        f.rt().frames().task_end(f.thread_a);
        f.clock.advance(10ms);
        return holds;
    };
    CHECK(holds_of_loose() == 1);
    for (int i = 0; i < 20; ++i) {
        launched = true;
        holds_of_loose();
    }
    const auto before = holds_of_loose();
    launched = true;
    CHECK(holds_of_loose() == before);
    CHECK(f.warnings().find("work of no chain") != std::string::npos);
}

TEST_CASE("A launch-bound task is not paced for marks", "[runtime][estimates]") {
    const auto sleeps = [](std::chrono::nanoseconds between) {
        RuntimeEstimatesTest f;
        auto& kernels = f.resolved.profile->chains[0].tasks[0].kernels;
        for (std::size_t i = 0; i < kernels.size(); ++i)
            kernels[i].launch_time = static_cast<int>(i) * between;
        f.begin(f.thread_b, "loose");  // or it would be alone
        f.launch(f.thread_b, kStreamB);
        f.begin(f.thread_a, "tight");
        const int before = f.clock.num_sleeps;
        for (int i = 0; i < 20; ++i) f.launch(f.thread_a);  // 2 ms of GPU time
        return f.clock.num_sleeps - before;
    };
    CHECK(sleeps(0us) > 0);
    CHECK(sleeps(300us) == 0);
}
