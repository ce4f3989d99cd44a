// SPDX-License-Identifier: Apache-2.0
//
// Who gives way when not all can be met, and that it is not always the same one.
#include "host/config/limits.h"
#include "tests/support/runtime_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

// Frames of both chains arrive at once, with 1 ms of CPU and 2 ms of GPU time each: alone each is
// in time, both together never are, and as far as deadlines go `loose` is the one to give up.
struct Rivals : RuntimeFixture {
    config::Chain& tight = resolved.config.chains[0];
    config::Chain& loose = resolved.config.chains[1];

    Rivals() {
        tight.deadline = 4400us;
        loose.deadline = 4500us;
        resolved.config.scheduler.guard = false;
        resolved.config.scheduler.packing.share_limit = resolved.config.scheduler.packing.limit;
    }
    /// Only instances of tasks that have a record are given up.
    void make_record() {
        for (int i = 0; i < 4; ++i)
            for (auto& [thread, chain] : {std::pair{&thread_a, "tight"}, {&thread_b, "loose"}}) {
                begin(*thread, chain);
                launch(*thread, thread == &thread_a ? kStreamA : kStreamB);
                driver.execute_marks(99);
                rt().frames().task_end(*thread);
                clock.advance(200ms);
            }
    }

    enum class End { kMissed, kInTime };
    /// One frame of each. @returns whether `loose` went before `tight`, which has begun already
    bool loose_goes_first(End of_loose) {
        const auto arrival = clock.now();
        begin(thread_a, "tight");
        begin(thread_b, "loose");
        launch(thread_a);
        const int sleeps = clock.num_sleeps;
        const Grant of_b = launch(thread_b, kStreamB);
        const bool waited = clock.num_sleeps > sleeps;
        if (!waited) CHECK(of_b.priority == -5);
        driver.execute_marks(99);
        if (of_loose == End::kMissed) clock.advance(arrival + 5ms - clock.now());
        REQUIRE(clock.now() < arrival + 5001us);
        rt().frames().task_end(thread_b);
        clock.advance(arrival + 6ms - clock.now());
        rt().frames().task_end(thread_a);
        clock.advance(200ms);
        return !waited;
    }
};

}  // namespace

TEST_CASE("Runtime puts a chain first that has missed as many in a row as it may, until it is met",
          "[runtime][criticality]") {
    Rivals f;
    f.loose.max_consecutive_misses = 3;
    f.tight.criticality = config::kCriticality.max;  // and before the most critical of the others
    f.make_record();
    for (int round = 0; round < 2; ++round) {
        for (int missed = 0; missed < 3; ++missed)
            CHECK_FALSE(f.loose_goes_first(Rivals::End::kMissed));
        CHECK(f.loose_goes_first(Rivals::End::kMissed));  // at the limit, and again beyond it
        CHECK(f.loose_goes_first(Rivals::End::kInTime));
        CHECK(f.stats(1).frames.misses_in_a_row == 0);
    }
    CHECK(f.stats(1).frames.most_misses_in_a_row == 4);
    CHECK_FALSE(f.loose_goes_first(Rivals::End::kInTime));
}

TEST_CASE("Runtime tells why a frame was given up", "[runtime][criticality][causes]") {
    Rivals f;
    f.make_record();
    CHECK_FALSE(f.loose_goes_first(Rivals::End::kMissed));
    const abi::ChainStatus& loose = f.rt().status().chain(1);
    const abi::MissCause cause{loose.last_cause.load()};
    CHECK(cause == abi::MissCause::kGivenUpItself);
    // 4 ms of the GPU, from now on, in 4.5 ms; less the first's CPU time.
    CHECK(observe::short_by(cause, loose.last_detail) > 0ms);
    CHECK(observe::short_by(cause, loose.last_detail) < 1ms);
    CHECK(loose.causes[static_cast<std::size_t>(cause)] == 1);
}

TEST_CASE("Runtime puts nobody first for its misses without a limit", "[runtime][criticality]") {
    Rivals f;
    for (int missed = 0; missed < 20; ++missed)
        CHECK_FALSE(f.loose_goes_first(Rivals::End::kMissed));
}

TEST_CASE("Runtime goes by criticality among chains at their limits", "[runtime][criticality]") {
    Rivals f;
    f.tight.max_consecutive_misses = f.loose.max_consecutive_misses = 1;
    f.loose.criticality = 2;
    f.make_record();
    CHECK(f.loose_goes_first(Rivals::End::kMissed));        // more critical anyway
    CHECK(f.loose_goes_first(Rivals::End::kInTime));        // both are at it
    CHECK_FALSE(f.loose_goes_first(Rivals::End::kInTime));  // `tight` alone is
}
