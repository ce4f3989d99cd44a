// SPDX-License-Identifier: Apache-2.0
//
// What looks at a task's marks tell of the GPU's clock, and where they say that the GPU is.
#include "host/progress/positions.h"

#include "tests/support/catch.h"
#include "tests/support/fake_driver.h"

using namespace urgengo;
using namespace std::chrono_literals;
using config::Tracking;
using progress::Positions;

namespace {

/// Launches of 100 us each, on a GPU whose clock shows the host's time.
struct PositionsTest {
    explicit PositionsTest(Tracking tracking = Tracking::kProgress)
        : positions(tracking, 2us, clock) {
        line_of = &line;
    }

    progress::FollowedTask task() {
        return {slot, line_of, pending_ns, planned_from, log, pace, plan};
    }
    void launch(int count, bool logged = true) {
        for (; count > 0; --count) {
            gpu_time += 100us;
            slot.launched_ns = gpu_time.count();
            if (logged) log.launched(100us, {.time = clock.now(), .position = position++});
        }
    }
    void mark() {
        log.marked(clock.now(), ++issued);
        slot.launched_at_mark_ns[issued % abi::kMarkRing] = gpu_time.count();
        slot.marks_issued = issued;
    }
    /// The GPU executes the newest mark, now.
    void execute_mark() {
        line.clock = clock_kind;
        line.word[0] = ug_mark_word0(position, 0, issued);
        line.word[1] = ug_mark_word1(static_cast<std::uint64_t>(clock.now().count()), issued);
    }
    /// One launch with a mark behind it, both executed when they should be.
    void execute_launch() {
        launch(1);
        mark();
        clock.advance(100us);
        execute_mark();
    }
    std::optional<progress::TaskPosition> locate(bool shared = false) {
        return positions.locate(task(), shared, clock.now());
    }

    testing::HookedClock clock;
    Positions positions;
    abi::TaskSlot slot;
    ug_mark_line line{};
    std::atomic<const ug_mark_line*> line_of{nullptr};
    std::atomic<std::int64_t> pending_ns{0};
    std::atomic<std::uint32_t> planned_from{0};
    model::LaunchLog log;
    model::Pace pace;
    model::TaskPlan plan;
    std::chrono::nanoseconds gpu_time{0};
    std::uint32_t position = 0, issued = 0, clock_kind = UG_MARK_CLOCK_GPU;
};

}  // namespace

TEST_CASE("Positions are of tasks that have launched", "[progress][positions]") {
    PositionsTest f;
    CHECK_FALSE(f.locate());
    f.launch(1);
    CHECK(f.locate());
}

TEST_CASE("Positions learn the GPU's clock from a mark that was seen", "[progress][positions]") {
    PositionsTest f;
    f.launch(2);
    f.mark();
    CHECK(f.positions.gpu_clock().restarts() == 0);
    f.clock.advance(200us);
    f.execute_mark();
    f.clock.advance(1us);
    SECTION("by whoever sees it first") {
        f.positions.saw_mark(f.task(), f.line, f.clock.now() - 3us, false);
    }
    SECTION("or asks where the GPU is") {
        CHECK(f.locate()->at.executed == 200us);
    }
    REQUIRE(f.positions.gpu_clock().restarts() == 1);
    const auto stamp = static_cast<std::uint64_t>((f.clock.now() - 1us).count());
    CHECK(f.positions.gpu_clock().to_host(stamp));
}

TEST_CASE("Positions learn nothing of the GPU's clock from the host's", "[progress][positions]") {
    PositionsTest f;
    f.clock_kind = UG_MARK_CLOCK_HOST;
    f.launch(2);
    f.mark();
    f.clock.advance(200us);
    f.execute_mark();
    f.positions.saw_mark(f.task(), f.line, f.clock.now(), false);
    CHECK(f.positions.gpu_clock().restarts() == 0);
    CHECK(f.locate()->at.executed == 200us);
}

TEST_CASE("Positions go on with the time where marks are, and not between batches",
          "[progress][positions]") {
    for (const Tracking tracking : {Tracking::kProgress, Tracking::kBatched}) {
        PositionsTest f(tracking);
        f.clock_kind = UG_MARK_CLOCK_HOST;
        f.execute_launch();
        f.launch(5);
        f.clock.advance(250us);
        const bool goes_on = tracking == Tracking::kProgress;
        CHECK(f.locate()->at.launch == (goes_on ? 3 : 1));
    }
}

TEST_CASE("Positions of async are behind all that was launched", "[progress][positions]") {
    PositionsTest f(Tracking::kAsync);
    f.launch(5);
    CHECK(f.locate()->at.launch == 5);
    CHECK(f.locate()->at.executed == 500us);
}

TEST_CASE("Positions count launches that are not logged yet", "[progress][positions]") {
    PositionsTest f;
    f.clock_kind = UG_MARK_CLOCK_HOST;
    f.execute_launch();
    f.planned_from = 1;
    f.launch(4, false);
    f.clock.advance(10ms);
    // All of it should be over; each counts for kUnknownKernel.
    CHECK(f.locate()->at.executed >= 100us);
    CHECK(f.locate()->at.launch > 1);
}
