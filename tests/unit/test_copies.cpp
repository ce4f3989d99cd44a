// SPDX-License-Identifier: Apache-2.0
#include "host/sched/copies.h"

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using sched::CopyEnd;
using sched::CopyPace;
using sched::cut_copy;
using sched::nanoseconds;

namespace {

constexpr std::size_t kMiB = 1 << 20;
constexpr CopyEnd kDevice{0x10'0000'0000, 0x10'0000'0000, 64 * kMiB, false, false, 0};
constexpr CopyEnd kHost{0x20'0000'0000, 0x20'0000'0000, 64 * kMiB, true, false, 0};

CopyEnd moved(CopyEnd end, std::uintptr_t by) {
    end.begin += by;
    return end;
}

/// A copier of this laxity.
model::SlotView copier(int index, nanoseconds laxity) {
    model::SlotView view;
    view.task = index;
    view.laxity = laxity;
    return view;
}

bool must_wait(std::initializer_list<model::SlotView> tasks, std::initializer_list<bool> copying) {
    const std::vector<model::SlotView> views(tasks);
    config::Scheduler scheduler;
    scheduler.policy = config::Policy::kUrgency;
    return sched::copy_must_wait(scheduler, {0ns, views}, {copying.begin(), copying.size()});
}

}  // namespace

TEST_CASE("Copy is cut into slices of nearly equal size when it is larger than one",
          "[sched][copies]") {
    CHECK(cut_copy(8 * kMiB, 8 * kMiB, kDevice, kHost) == 0);
    CHECK(cut_copy(8 * kMiB + 1, 8 * kMiB, kDevice, kHost) == 4 * kMiB + 4096);
    CHECK(cut_copy(64 * kMiB, 8 * kMiB, kDevice, kHost) == 8 * kMiB);
    CHECK(cut_copy(64 * kMiB, 8 * kMiB, kHost, kDevice) == 8 * kMiB);
    CHECK(cut_copy(64 * kMiB, 0, kDevice, kHost) == 0);
    for (const std::size_t slice : {65'536ul, 65'537ul, 100'000ul, 3 * kMiB})
        for (const std::size_t bytes : {slice + 1, 2 * slice - 1, 2 * slice, 5 * slice + 17}) {
            const std::size_t cut = cut_copy(bytes, slice, kDevice, kHost);
            INFO(slice << ' ' << bytes << ' ' << cut);
            CHECK(cut > 0);
            CHECK(cut <= slice);
            CHECK(2 * cut >= slice);
        }
}

TEST_CASE("Copy is cut only inside one allocation at both ends", "[sched][copies]") {
    const auto cut = [](const CopyEnd& to, const CopyEnd& from) {
        return cut_copy(32 * kMiB, kMiB, to, from) != 0;
    };
    CHECK(cut(moved(kDevice, 32 * kMiB), moved(kHost, 32 * kMiB)));
    CHECK_FALSE(cut(moved(kDevice, 32 * kMiB + 1), kHost));
    CHECK_FALSE(cut(kDevice, moved(kHost, 32 * kMiB + 1)));
    CHECK_FALSE(cut(moved(kDevice, 64 * kMiB + 1), kHost));
    CHECK_FALSE(cut(moved(kDevice, 0ul - 1), kHost));
    CHECK_FALSE(cut(CopyEnd{kDevice.begin}, kHost));  // not known to the driver
    CopyEnd managed = kDevice;
    managed.is_managed = true;
    CHECK_FALSE(cut(managed, kHost));
    CHECK_FALSE(cut(kHost, managed));
    CHECK_FALSE(cut(kHost, moved(kHost, 32 * kMiB)));
}

TEST_CASE("Copy on the device is cut coarsely, and not where its ends overlap", "[sched][copies]") {
    const auto cut = [](std::size_t bytes, const CopyEnd& to, const CopyEnd& from) {
        return cut_copy(bytes, kMiB, to, from);
    };
    CHECK(cut(32 * kMiB, moved(kDevice, 32 * kMiB), kDevice) == 16 * kMiB);
    CHECK(cut(32 * kMiB, kDevice, moved(kDevice, 32 * kMiB)) == 16 * kMiB);
    CHECK(cut(16 * kMiB, moved(kDevice, 32 * kMiB), kDevice) == 0);
    CHECK(cut(32 * kMiB, moved(kDevice, 32 * kMiB - 1), kDevice) == 0);
    CHECK(cut(32 * kMiB, kDevice, moved(kDevice, 32 * kMiB - 1)) == 0);
    CHECK(cut(32 * kMiB, kDevice, kDevice) == 0);
    CopyEnd peer = moved(kDevice, 32 * kMiB);
    peer.device = 1;
    CHECK(cut(32 * kMiB, peer, kDevice) == 0);
}

TEST_CASE("Pace has room for two pieces, and small copies make one together", "[sched][copies]") {
    CopyPace pace;
    CHECK(pace.is_idle());
    CHECK_FALSE(pace.copied(kMiB, 8 * kMiB));
    CHECK_FALSE(pace.copied(kMiB, 8 * kMiB));
    CHECK(pace.copied(2 * kMiB, 8 * kMiB));
    CHECK(pace.next() == 0);
    pace.marked(1ms);
    CHECK(pace.has_room());
    CHECK(pace.copied(8 * kMiB, 8 * kMiB));
    CHECK(pace.next() == 1);
    pace.marked(1ms);
    CHECK_FALSE(pace.has_room());
    CHECK(pace.bytes_under_way() == 12 * kMiB);
    CHECK(pace.oldest() == 0);
    pace.finished(2ms, true);
    CHECK(pace.oldest() == 1);
    CHECK(pace.has_room());
    CHECK(pace.bytes_under_way() == 8 * kMiB);
    pace.copied(8 * kMiB, 8 * kMiB);
    CHECK(pace.bytes_under_way() == 16 * kMiB);  // with no event behind it yet
    CHECK(pace.next() == 0);
    pace.marked(2ms);
    pace.forget();
    CHECK(pace.is_idle());
    CHECK(pace.bytes_under_way() == 0);
}

TEST_CASE("Pace tells the speed of a piece that was next when the one before it ended",
          "[sched][copies]") {
    CopyPace pace;
    const auto issue = [&](nanoseconds now) {
        pace.copied(1'000'000, kMiB);
        pace.marked(now);
    };
    issue(1ms);
    issue(1ms);
    CHECK_FALSE(pace.finished(2ms, true));  // since when it ran is not known
    CHECK(pace.finished(2ms + 50us, true) == 20.0);
    issue(3ms);
    CHECK_FALSE(pace.finished(4ms, true));  // the engine was idle before
    issue(4ms);
    issue(4ms);
    CHECK_FALSE(pace.finished(5ms, false));
    CHECK_FALSE(pace.finished(6ms, true));  // when the one before it ended is not known
    issue(6ms);
    CHECK_FALSE(pace.finished(7ms, false));
    issue(8ms);
    CHECK_FALSE(pace.finished(9ms, true));
    issue(9ms);  // just when the one before it ended
    CHECK(pace.finished(9ms + 100us, true) == 10.0);
    issue(9ms + 100us);
    CHECK_FALSE(pace.finished(9ms + 100us, true));  // in no time
}

TEST_CASE("Piece is overdue after twice its time at 10 GB/s and a millisecond", "[sched][copies]") {
    CopyPace pace;
    for (int i = 0; i < 2; ++i) {
        pace.copied(1'000'000, kMiB);  // 100 us at 10 GB/s
        pace.marked(10ms);
    }
    CHECK_FALSE(pace.is_overdue(11ms + 200us));
    CHECK(pace.is_overdue(11ms + 201us));
    pace.finished(11ms, true);  // then the next one begins
    CHECK_FALSE(pace.is_overdue(12ms + 200us));
    CHECK(pace.is_overdue(12ms + 201us));
}

TEST_CASE("Pace sleeps until a piece should be done, then looks often", "[sched][copies]") {
    CopyPace pace;
    pace.copied(8'000'000, kMiB);
    pace.marked(10ms);
    CHECK(pace.sleep(10ms, 50, 1ms) == 160us);
    CHECK(pace.sleep(10ms, 50, 50us) == 50us);
    CHECK(pace.sleep(10ms + 150us, 50, 1ms) == 20us);
    CHECK(pace.sleep(11ms, 50, 1ms) == 20us);
    CHECK(pace.sleep(11ms, 1000, 1ms) == 10us);
    CHECK(pace.sleep(11ms, 50, 10us) == 10us);
}

TEST_CASE("Copy waits for unfinished copies of more urgent tasks, and for nothing else",
          "[sched][copies]") {
    CHECK_FALSE(must_wait({copier(1, 10ms)}, {true}));
    CHECK(must_wait({copier(1, 10ms), copier(0, 5ms)}, {true, true}));
    CHECK(must_wait({copier(1, 10ms), copier(2, 50ms), copier(3, 5ms)}, {false, true, true}));
    CHECK_FALSE(must_wait({copier(1, 10ms), copier(0, 5ms)}, {true, false}));
    CHECK_FALSE(must_wait({copier(1, 10ms), copier(0, 20ms)}, {true, true}));
    CHECK_FALSE(must_wait({copier(1, 10ms), copier(0, -1ms)}, {true, true}));  // late already
    // Ties go to the lower index, as among launches.
    CHECK(must_wait({copier(1, 10ms), copier(0, 10ms)}, {true, true}));
    CHECK_FALSE(must_wait({copier(1, 10ms), copier(2, 10ms)}, {true, true}));
}
