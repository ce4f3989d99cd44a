// SPDX-License-Identifier: Apache-2.0
#include "host/model/slot_view.h"

#include <memory>

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using abi::TaskState;
using model::nanoseconds;
using model::read_slot;

namespace {

// A task that launches 2 ms before each of its marks 1..4, of 10 ms in all.
struct SlotViewTest {
    std::unique_ptr<abi::TaskSlot> slot = std::make_unique<abi::TaskSlot>();
    ug_mark_line line{};
    nanoseconds now = 1000ms;

    SlotViewTest() {
        slot->state = TaskState::kGpu;
        slot->deadline_ns = nanoseconds(1100ms).count();
        slot->head_utilization_ppm = 250'000;
        slot->launch_ns = nanoseconds(now - 1ms).count();
        slot->progress_ns = slot->launch_ns.load();
        issued(0);
    }

    /// `marks` are issued; `unmarked` more was launched since.
    void issued(std::uint32_t marks, nanoseconds unmarked = 0ms) {
        for (std::uint32_t m = 0; m <= marks; ++m)
            slot->launched_at_mark_ns[m] = nanoseconds(m * 2ms).count();
        slot->marks_issued = marks;
        slot->launched_ns = nanoseconds(marks * 2ms + unmarked).count();
        slot->head_remaining_ns = nanoseconds(10ms - marks * 2ms - unmarked).count();
    }
    void executed(std::uint32_t mark) {
        line.word[0] = ug_mark_word0(0, 0, mark);
        line.word[1] = 123ull << 16 | (mark & 0xffff);
    }
    /// So much, launched now behind that mark, no mark tells of.
    void goes_by_time(nanoseconds time, std::uint32_t mark) {
        now = nanoseconds(now.count() & ~0xff);
        slot->progress_ns = now.count();
        slot->launch_ns = now.count();
        model::UnmarkedWork work;
        work.launched(now, nanoseconds(time.count() & ~0xff), nanoseconds{0}, true, mark);
        slot->unmarked_until = work.word();
    }
    model::SlotView view() { return read_slot(*slot, &line, 3, now); }
};

}  // namespace

TEST_CASE("SlotView counts what was launched and not executed as remaining", "[model][slot_view]") {
    SlotViewTest f;
    f.issued(4);
    f.executed(1);
    CHECK(f.view().ahead.launched == 6ms);
    CHECK(f.view().laxity == 100ms - 8ms);
    f.executed(4);
    CHECK(f.view().ahead.launched == 0ms);
    CHECK(f.view().laxity == 100ms - 2ms);
    CHECK(f.view().utilization == Approx(0.25));
    CHECK(f.view().task == 3);
}

TEST_CASE("SlotView adds the chain's later tasks to what remains", "[model][slot_view]") {
    SlotViewTest f;
    f.issued(0);
    f.slot->later_gpu_ns = nanoseconds(20ms).count();
    f.slot->later_cpu_ns = nanoseconds(5ms).count();
    CHECK(f.view().laxity == 100ms - 10ms - 25ms);
}

TEST_CASE("SlotView blocks while a task has unfinished work, is held, or has just launched",
          "[model][slot_view]") {
    SlotViewTest f;
    CHECK_FALSE(
        f.view().state.ranked);  // last launch 1 ms ago, nothing unfinished: waits elsewhere
    f.slot->launch_ns = nanoseconds(f.now - 100us).count();
    CHECK(f.view().state.blocking);  // within the grace between two launches
    f.slot->launch_ns = nanoseconds(f.now - 1ms).count();
    f.issued(0, 500us);
    CHECK(f.view().state.blocking);  // launched, not marked yet
    f.issued(1);
    CHECK(f.view().state.blocking);
    f.executed(1);
    CHECK_FALSE(f.view().state.ranked);
    f.slot->state = TaskState::kHeld;
    f.slot->look_ns = nanoseconds(f.now - 1ms).count();
    CHECK(f.view().state.blocking);
    f.slot->state = TaskState::kCpu;
    CHECK_FALSE(f.view().state.ranked);
    f.slot->state = TaskState::kIdle;
    CHECK_FALSE(f.view().state.ranked);
}

TEST_CASE("SlotView keeps the rank of a task whose work is overdue but lets it block nobody",
          "[model][slot_view]") {
    SlotViewTest f;
    f.issued(1);
    f.slot->progress_ns = nanoseconds(f.now - 10ms).count();
    CHECK(f.view().state.ranked);
    CHECK(f.view().state.overdue);
    CHECK_FALSE(f.view().state.blocking);
    f.slot->state = TaskState::kHeld;  // held for its own run-ahead behind that work
    f.slot->look_ns = f.now.count();
    CHECK_FALSE(f.view().state.blocking);
    f.issued(0, 1ms);  // without a mark: from the last launch
    f.slot->launch_ns = nanoseconds(f.now - 3ms).count();
    CHECK_FALSE(f.view().state.overdue);
    f.slot->launch_ns = nanoseconds(f.now - 3ms - 1ns).count();
    CHECK(f.view().state.overdue);
}

TEST_CASE("SlotView has overdue work block others for as long as it is let have the GPU",
          "[model][slot_view]") {
    SlotViewTest f;
    f.issued(1);
    f.slot->progress_ns = nanoseconds(f.now - 10ms).count();
    f.slot->cleared_until_ns = f.now.count() + 1;
    CHECK(f.view().state.blocking);
    CHECK(f.view().state.overdue);  // and is not paced for it
    CHECK(f.view().ahead.waited == 10ms);
    CHECK(f.view().ahead.patience == 2 * 2ms + 1ms);
    f.slot->cleared_until_ns = f.now.count();
    CHECK_FALSE(f.view().state.blocking);
    f.executed(1);
    f.slot->cleared_until_ns = f.now.count() + 1;
    CHECK_FALSE(f.view().state.blocking);  // nothing on the GPU
}

TEST_CASE("SlotView takes a mark for done that the launching thread has not published yet",
          "[model][slot_view]") {
    SlotViewTest f;
    f.issued(4);
    f.slot->launched_at_mark_ns[5] = nanoseconds(10ms).count();
    f.slot->launched_ns = nanoseconds(10ms).count();
    f.executed(5);
    CHECK(f.view().ahead.launched == 0ms);
    CHECK(f.slot->marks_done == 5);
}

TEST_CASE("SlotView stops blocking when the next mark is overdue", "[model][slot_view]") {
    SlotViewTest f;
    f.issued(1);  // 2 ms of work: overdue after 2 * 2 ms + 1 ms
    f.slot->progress_ns = nanoseconds(f.now - 5ms).count();
    CHECK(f.view().state.blocking);
    f.slot->progress_ns = nanoseconds(f.now - 5ms - 1ns).count();
    CHECK_FALSE(f.view().state.blocking);
}

TEST_CASE("SlotView stops blocking when a held thread has not looked for long",
          "[model][slot_view]") {
    SlotViewTest f;
    f.slot->state = TaskState::kHeld;
    f.slot->look_ns = nanoseconds(f.now - nanoseconds(model::kHeldHeartbeat_ns) + 1ns).count();
    CHECK(f.view().state.ranked);
    f.slot->look_ns = nanoseconds(f.now - nanoseconds(model::kHeldHeartbeat_ns)).count();
    CHECK_FALSE(f.view().state.ranked);
}

TEST_CASE("SlotView publishes the progress that it sees", "[model][slot_view]") {
    SlotViewTest f;
    f.issued(4);
    f.executed(3);
    f.view();
    CHECK(f.slot->marks_done == 3);
    CHECK(nanoseconds(f.slot->progress_ns) == f.now);
    f.executed(2);  // an older mark, late, from another stream: never goes back
    CHECK(f.view().ahead.launched == 2ms);
    CHECK(f.slot->marks_done == 3);
}

TEST_CASE("SlotView follows marks across the wrap of the tag and of the ring",
          "[model][slot_view]") {
    SlotViewTest f;
    for (std::uint32_t base : {65533u, 0xfffffffdu}) {
        for (std::uint32_t i = 0; i <= 4; ++i)
            f.slot->launched_at_mark_ns[(base + i) % abi::kMarkRing] = nanoseconds(i * 2ms).count();
        f.slot->marks_done = base;
        f.slot->marks_issued = base + 4;
        f.slot->launched_ns = nanoseconds(8ms).count();
        f.executed(base + 3);
        CHECK(f.view().ahead.launched == 2ms);
        CHECK(f.slot->marks_done == base + 3);
    }
}

TEST_CASE("SlotView keeps the last known progress when a line is torn", "[model][slot_view]") {
    SlotViewTest f;
    f.issued(4);
    f.executed(2);
    f.view();
    f.line.word[0] = ug_mark_word0(0, 0, 3);  // word 1 still says 2
    CHECK(f.view().ahead.launched == 4ms);
}

TEST_CASE("SlotView does not trust a slot that is being written", "[model][slot_view]") {
    SlotViewTest f;
    f.issued(1);
    CHECK(f.view().state.ranked);
    f.slot->version = 1;
    CHECK_FALSE(f.view().state.ranked);
}

TEST_CASE("SlotView of a wait for all GPU work needs the whole GPU until it should be over",
          "[model][slot_view]") {
    SlotViewTest f;
    f.slot->state = TaskState::kSync;
    f.slot->sync_until_ns = nanoseconds(f.now + 3ms).count();
    f.now += 2ms;
    CHECK(f.view().state.blocking);
    CHECK(f.view().utilization == 1);
    f.now += 2ms;
    CHECK_FALSE(f.view().state.ranked);
    // A helper thread of the task wants to launch: it counts as it would without the wait.
    f.slot->look_ns = f.now.count();
    CHECK(f.view().state.blocking);
    CHECK(f.view().utilization == Approx(0.25));
}

TEST_CASE("SlotView counts what no mark can tell of by time, for what remains alone",
          "[model][slot_view]") {
    SlotViewTest f;
    f.issued(1, 6ms);  // a fork; 2 ms remain to be launched
    f.executed(1);
    f.slot->progress_ns = f.now.count();
    f.slot->marks_done = 1;
    f.slot->launch_ns = f.now.count();
    f.goes_by_time(6ms, 1);
    CHECK(f.view().laxity == 100ms - 8ms);
    f.now += 4ms;
    CHECK(f.view().remaining.gpu == 4ms);
    CHECK(f.view().ahead.launched == 6ms);  // for who waits for room
    CHECK(f.view().laxity == 96ms - 4ms);
}

TEST_CASE("SlotView has work by time begin behind the mark before it, and end at the next one",
          "[model][slot_view]") {
    SlotViewTest f;
    f.issued(3, 1ms);  // from the second mark to the third no mark tells
    f.slot->marks_done = 1;
    f.executed(1);
    f.goes_by_time(2ms, 2);
    const nanoseconds not_launched = 3ms;
    f.now += 1ms;
    CHECK(f.view().remaining.gpu == not_launched + 5ms);
    f.executed(2);  // seen now
    CHECK(f.view().remaining.gpu == not_launched + 3ms);
    f.now += 1ms;
    CHECK(f.view().remaining.gpu == not_launched + 2ms);
    f.now += 5ms;
    CHECK(f.view().remaining.gpu == not_launched + 1ms);
    CHECK(f.view().ahead.launched == 3ms);
    f.executed(3);
    CHECK(f.view().remaining.gpu == not_launched + 1ms);
}
