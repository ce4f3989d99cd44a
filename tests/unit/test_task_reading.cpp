// SPDX-License-Identifier: Apache-2.0
#include "host/model/task_reading.h"

#include <memory>
#include <tuple>

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using abi::TaskState;

namespace {

constexpr std::int64_t kNow_ns = 5'000'000'000;

/// @returns whether host and GPU see the same of the task
bool is_seen_alike(const abi::TaskSlot& slot) {
    const auto seen = [&](bool at_once) {
        model::TaskReading reading = model::load_slot(slot, at_once);
        model::load_marks(reading, slot, slot.marks_issued, slot.marks_done);
        const model::SlotView view = model::view_of(reading, 0, std::chrono::nanoseconds(kNow_ns));
        return std::tuple(reading.gates.opened, reading.gates.opened_ns, reading.thread.queue_why,
                          reading.is_gated(), view.ahead.waited, view.state.overdue,
                          view.state.blocking, view.launching.is_next, view.deadline, view.laxity);
    };
    return seen(true) == seen(false);
}

}  // namespace

TEST_CASE("What a look of the host's does not read does not count for the GPU either",
          "[model][task_reading]") {
    auto slot = std::make_unique<abi::TaskSlot>();
    slot->state = TaskState::kGpu;
    slot->launched_ns = 3'000'000;
    slot->launch_ns = kNow_ns - 90'000'000;
    slot->head_remaining_ns = 1'000'000;
    CHECK(is_seen_alike(*slot));
    SECTION("when the last gate opened, of a task that has had none") {
        slot->gate_opened_ns = kNow_ns - 1000;
        CHECK(is_seen_alike(*slot));
    }
    SECTION("what it last waited for, of a task that is not held") {
        slot->queue_why = abi::Why::kTurnToLaunch;
        slot->look_ns = kNow_ns - 1000;
        CHECK(is_seen_alike(*slot));
        slot->gates_closed = 1;
        CHECK(is_seen_alike(*slot));
        slot->state = TaskState::kHeld;
        CHECK(is_seen_alike(*slot));
    }
    SECTION("a lent deadline that is over") {
        slot->lent_deadline_ns = kNow_ns;
        slot->lent_criticality = 3;
        CHECK(is_seen_alike(*slot));
    }
}
