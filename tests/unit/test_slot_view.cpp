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

// A task with 10 ms of GPU work, of which marks 1..4 say 8, 6, 4, 2 ms remain.
struct Fixture {
    std::unique_ptr<abi::TaskSlot> slot = std::make_unique<abi::TaskSlot>();
    ug_mark_line line{};
    nanoseconds now = 1000ms;

    Fixture() {
        slot->state = TaskState::kGpu;
        slot->deadline_ns = nanoseconds(1100ms).count();
        slot->head_utilization_ppm = 250'000;
        for (int mark = 0; mark <= 4; ++mark)
            slot->remaining_after_mark_ns[mark] = nanoseconds(10ms - mark * 2ms).count();
        slot->activity_ns = nanoseconds(now - 1ms).count();
        slot->progress_ns = slot->activity_ns.load();
    }

    void issued(std::uint32_t marks, nanoseconds head_remaining) {
        slot->marks_issued = marks;
        slot->head_remaining_ns = head_remaining.count();
    }
    void executed(std::uint32_t mark) {
        line.word[0] = ug_mark_word0(0, 0, mark);
        line.word[1] = 123ull << 16 | (mark & 0xffff);
    }
    model::SlotView view() { return read_slot(*slot, &line, 3, now); }
};

}  // namespace

TEST_CASE("SlotView counts what was launched and not executed as remaining", "[model][slot_view]") {
    Fixture f;
    f.issued(4, 2ms);
    f.executed(1);
    CHECK(f.view().launched == 6ms);
    CHECK(f.view().laxity == 100ms - 8ms);
    f.executed(4);
    CHECK(f.view().launched == 0ms);
    CHECK(f.view().laxity == 100ms - 2ms);
    CHECK(f.view().utilization == Approx(0.25));
    CHECK(f.view().task == 3);
}

TEST_CASE("SlotView adds the chain's later tasks to what remains", "[model][slot_view]") {
    Fixture f;
    f.issued(0, 10ms);
    f.slot->later_gpu_ns = nanoseconds(20ms).count();
    f.slot->later_cpu_ns = nanoseconds(5ms).count();
    CHECK(f.view().laxity == 100ms - 10ms - 25ms);
}

TEST_CASE("SlotView blocks while a task has unfinished work, is held, or has just launched",
          "[model][slot_view]") {
    Fixture f;
    f.issued(0, 10ms);
    CHECK_FALSE(f.view().blocking);  // last launch 1 ms ago, nothing unfinished: waits elsewhere
    f.slot->activity_ns = nanoseconds(f.now - 100us).count();
    CHECK(f.view().blocking);  // within the grace between two launches
    f.slot->activity_ns = nanoseconds(f.now - 1ms).count();
    f.issued(1, 8ms);
    CHECK(f.view().blocking);
    f.executed(1);
    CHECK_FALSE(f.view().blocking);
    f.slot->state = TaskState::kHeld;
    CHECK(f.view().blocking);
    f.slot->state = TaskState::kCpu;
    CHECK_FALSE(f.view().blocking);
    f.slot->state = TaskState::kIdle;
    CHECK_FALSE(f.view().blocking);
}

TEST_CASE("SlotView stops blocking when the next mark is overdue", "[model][slot_view]") {
    Fixture f;
    f.issued(1, 8ms);  // 2 ms of work: overdue after 2 * 2 ms + 1 ms
    f.slot->progress_ns = nanoseconds(f.now - 5ms).count();
    CHECK(f.view().blocking);
    f.slot->progress_ns = nanoseconds(f.now - 5ms - 1ns).count();
    CHECK_FALSE(f.view().blocking);
}

TEST_CASE("SlotView stops blocking when a held thread has not looked for long",
          "[model][slot_view]") {
    Fixture f;
    f.slot->state = TaskState::kHeld;
    f.slot->activity_ns = nanoseconds(f.now - model::kHeldHeartbeat).count();
    CHECK_FALSE(f.view().blocking);
}

TEST_CASE("SlotView publishes the progress that it sees", "[model][slot_view]") {
    Fixture f;
    f.issued(4, 2ms);
    f.executed(3);
    f.view();
    CHECK(f.slot->marks_done == 3);
    CHECK(nanoseconds(f.slot->progress_ns) == f.now);
    f.executed(2);  // an older reading, late: never goes back
    f.view();
    CHECK(f.slot->marks_done == 3);
}

TEST_CASE("SlotView follows marks across the wrap of the tag and of the ring",
          "[model][slot_view]") {
    Fixture f;
    for (std::uint32_t base : {65533u, 0xfffffffdu}) {
        for (std::uint32_t i = 0; i <= 4; ++i)
            f.slot->remaining_after_mark_ns[(base + i) % abi::kMarkRing] =
                nanoseconds(10ms - i * 2ms).count();
        f.slot->marks_done = base;
        f.issued(base + 4, 2ms);
        f.executed(base + 3);
        CHECK(f.view().launched == 2ms);
        CHECK(f.slot->marks_done == base + 3);
    }
}

TEST_CASE("SlotView keeps the last known progress when a line is torn", "[model][slot_view]") {
    Fixture f;
    f.issued(4, 2ms);
    f.executed(2);
    f.view();
    f.line.word[0] = ug_mark_word0(0, 0, 3);  // word 1 still says 2
    CHECK(f.view().launched == 4ms);
}

TEST_CASE("SlotView does not trust a slot that is being written", "[model][slot_view]") {
    Fixture f;
    f.slot->state = TaskState::kHeld;
    f.slot->version = 1;
    CHECK_FALSE(f.view().blocking);
}
