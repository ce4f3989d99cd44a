// SPDX-License-Identifier: Apache-2.0
//
// The rules of the paper's ways of tracking by themselves: no runtime, no driver.
#include "host/progress/batch_tracking.h"

#include <vector>

#include "host/model/position.h"
#include "tests/support/catch.h"
#include "tests/support/fake_driver.h"

using namespace urgengo;
using namespace std::chrono_literals;
using config::Tracking;
using progress::BatchTracking;
using Outcome = BatchTracking::Outcome;

namespace {

struct Fixture final : progress::BatchEnds {
    explicit Fixture(Tracking tracking) : tracks(tracking, 200us, clock) {}

    bool record(std::uint32_t batch) override {
        recorded.push_back(batch);
        return !refuses;
    }
    Seen ask(std::uint32_t batch) override {
        asked.push_back(batch);
        return answer;
    }
    bool are_wanted() override { return wanted; }

    progress::BatchedTask task() {
        return {batches, slot, line, log, position_at_mark, marked, gpu_time, position};
    }
    void launch(std::chrono::nanoseconds estimate = 100us) {
        gpu_time += estimate;
        log.launched(estimate, {.time = clock.now(), .position = position++});
        tracks.launched(task(), estimate);
    }
    Outcome end_batch() { return tracks.end_batch(task(), *this, 1ms); }
    /// By what others read.
    std::uint32_t executed_launches() { return static_cast<std::uint32_t>(line.word[0] >> 32); }

    testing::HookedClock clock;
    BatchTracking tracks;
    progress::TaskBatches batches;
    abi::TaskSlot slot;
    ug_mark_line line{};
    model::LaunchLog log;
    std::array<std::uint32_t, abi::kMarkRing> position_at_mark{};
    std::chrono::nanoseconds marked{0}, gpu_time{0};
    std::uint32_t position = 0;
    bool refuses = false, wanted = true;
    Seen answer = Seen::kYes;
    std::vector<std::uint32_t> recorded, asked;
};

}  // namespace

TEST_CASE("BatchTracking ends a batch when its estimated time is launched", "[tracking]") {
    Fixture f(Tracking::kBatched);
    f.tracks.begin_segment(f.task());
    CHECK(f.line.clock == UG_MARK_CLOCK_HOST);
    f.launch();
    CHECK_FALSE(f.tracks.is_due(f.task()));
    f.launch();
    CHECK(f.tracks.is_due(f.task()));
    CHECK(f.end_batch() == Outcome::kFine);
    CHECK(f.recorded == std::vector<std::uint32_t>{1});
    CHECK(f.asked == f.recorded);
    CHECK(f.executed_launches() == 2);
    CHECK(f.batches.num_waits == 1);
    CHECK_FALSE(f.tracks.is_due(f.task()));
}

TEST_CASE("BatchTracking of sync ends a batch with every launch", "[tracking]") {
    Fixture f(Tracking::kSync);
    CHECK_FALSE(f.tracks.is_due(f.task()));
    f.launch(1ns);
    CHECK(f.tracks.is_due(f.task()));
    CHECK(f.end_batch() == Outcome::kFine);
    CHECK_FALSE(f.tracks.is_due(f.task()));
}

TEST_CASE("BatchTracking of overlapped lets the last batch execute", "[tracking]") {
    Fixture f(Tracking::kOverlapped);
    f.launch(200us);
    CHECK(f.end_batch() == Outcome::kFine);
    CHECK(f.asked.empty());
    CHECK_FALSE(f.tracks.must_wait(f.task(), 1));
    CHECK(f.tracks.must_wait(f.task(), 0));
    f.launch(200us);
    CHECK(f.end_batch() == Outcome::kFine);
    REQUIRE(f.tracks.must_wait(f.task(), 1));
    CHECK(f.tracks.wait(f.task(), 1, f, 1ms) == Outcome::kFine);
    CHECK(f.asked == std::vector<std::uint32_t>{1});
    CHECK(f.executed_launches() == 1);
    CHECK_FALSE(f.tracks.must_wait(f.task(), 1));
}

TEST_CASE("BatchTracking of async asks nothing and is a nanosecond short of the end",
          "[tracking]") {
    Fixture f(Tracking::kAsync);
    f.tracks.begin_segment(f.task());
    f.launch();
    f.launch();
    CHECK_FALSE(f.tracks.is_due(f.task()));
    CHECK(f.end_batch() == Outcome::kFine);
    CHECK((f.recorded.empty() && f.asked.empty()));
    CHECK(f.slot.launched_at_mark_ns[0] == (f.gpu_time - 1ns).count());
    f.tracks.end_segment(f.task());
    CHECK(f.executed_launches() == 2);
    CHECK(f.slot.launched_at_mark_ns[1] == f.gpu_time.count());
}

TEST_CASE("BatchTracking waits no longer than it may, and then no more", "[tracking]") {
    Fixture f(Tracking::kBatched);
    f.answer = progress::BatchEnds::Seen::kNotYet;
    f.launch(200us);
    const auto begin = f.clock.now();
    CHECK(f.end_batch() == Outcome::kWaitedInVain);
    CHECK(f.clock.now() >= begin + 1ms);
    CHECK(f.clock.now() < begin + 1200us);
    CHECK(f.executed_launches() == 0);
    f.launch(200us);
    CHECK_FALSE(f.tracks.is_due(f.task()));
    CHECK(f.end_batch() == Outcome::kFine);
    CHECK(f.recorded.size() == 1);
}

TEST_CASE("BatchTracking ends a wait that nobody wants, or that the driver refuses", "[tracking]") {
    Fixture f(Tracking::kBatched);
    f.answer = progress::BatchEnds::Seen::kNotYet;
    f.wanted = false;
    f.launch(200us);
    CHECK(f.end_batch() == Outcome::kFine);
    CHECK_FALSE(f.batches.waited_in_vain);
    f.answer = progress::BatchEnds::Seen::kRefused;
    f.launch(200us);
    CHECK(f.end_batch() == Outcome::kRefused);
    f.refuses = true;
    f.launch(200us);
    const auto issued = f.slot.marks_issued.load();
    CHECK(f.end_batch() == Outcome::kRefused);
    CHECK(f.slot.marks_issued == issued);
}
