// SPDX-License-Identifier: Apache-2.0
#include "host/model/starvation.h"

#include <memory>

#include "host/model/slot_view.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using model::nanoseconds;

namespace {

// An instance with a deadline of 50 ms, late by 300 ms.
struct Late {
    std::unique_ptr<abi::TaskSlot> slot = std::make_unique<abi::TaskSlot>();
    nanoseconds now = 10'000ms, deadline = now - 300ms;

    bool is_starved(nanoseconds waits = 0ms) {
        return model::is_starved(*slot, deadline, 50ms, waits, now);
    }
    /// @returns for how long it comes before everybody, while it gives way the rest of the time
    nanoseconds turns_in(nanoseconds time) {
        nanoseconds turns{0};
        for (const nanoseconds end = now + time; now < end; now += 1ms) {
            if (is_starved())
                turns += 1ms;
            else
                model::gave_way(*slot, 1ms);
        }
        return turns;
    }
};

}  // namespace

TEST_CASE("Starved is only who has given way, not who came late by itself", "[model][starvation]") {
    Late f;
    CHECK_FALSE(f.is_starved());
    model::gave_way(*f.slot, 99ms);
    CHECK_FALSE(f.is_starved());
    model::gave_way(*f.slot, 1ms);
    CHECK(f.is_starved());
    f.now += 1s;
    model::forget_starvation(*f.slot);  // the next instance begins
    CHECK_FALSE(f.is_starved());
}

TEST_CASE("Starved is only who is late by more than four deadlines", "[model][starvation]") {
    Late f;
    model::gave_way(*f.slot, 10s);
    f.deadline = f.now - 200ms;
    CHECK_FALSE(f.is_starved());
    f.deadline -= 1ns;
    CHECK(f.is_starved());
    CHECK_FALSE(model::is_starved(*f.slot, f.deadline, 0ms, 10s, f.now));  // no chain's deadline
}

TEST_CASE("Work that is overdue on the GPU gives way as a held launch does",
          "[model][starvation]") {
    Late f;
    CHECK_FALSE(f.is_starved(99ms));
    CHECK(f.is_starved(100ms));
}

TEST_CASE("Who has starved comes first for one deadline, then gives way for twice as long",
          "[model][starvation]") {
    Late f;
    model::gave_way(*f.slot, 100ms);
    REQUIRE(f.is_starved());
    f.now += 50ms - 1ns;
    CHECK(f.is_starved());
    f.now += 1ns;
    CHECK_FALSE(f.is_starved());
    model::gave_way(*f.slot, 99ms);
    CHECK_FALSE(f.is_starved());
    model::gave_way(*f.slot, 1ms);
    CHECK(f.is_starved());
}

TEST_CASE("Who has starved leaves the others most of the time", "[model][starvation]") {
    Late f;
    const nanoseconds turns = f.turns_in(10s);
    CHECK(turns >= 250ms);  // but it has its turns
    CHECK(turns <= 500ms);
}

TEST_CASE("SlotView counts what a mark was seen late by as given way", "[model][slot_view]") {
    abi::TaskSlot slot{};
    slot.state = abi::TaskState::kGpu;
    slot.deadline_ns = nanoseconds(700ms).count();
    slot.relative_deadline_ns = nanoseconds(50ms).count();
    slot.launched_at_mark_ns[1] = slot.launched_ns = nanoseconds(2ms).count();
    slot.marks_issued = 1;
    slot.progress_ns = nanoseconds(899ms).count();
    ug_mark_line line{};
    // Overdue from 2 * 2 ms + 1 ms on.
    CHECK_FALSE(model::read_slot(slot, &line, 0, 1004ms - 1ns).state.starved);
    CHECK(model::read_slot(slot, &line, 0, 1004ms).state.starved);
    slot.turn_at_ns = slot.turn_until_ns = 0;
    line.word[0] = ug_mark_word0(0, 0, 1);
    line.word[1] = 1;
    CHECK(model::read_slot(slot, &line, 0, 1004ms).ahead.progressed);
    CHECK(slot.gave_way_ns == nanoseconds(100ms).count());
}
