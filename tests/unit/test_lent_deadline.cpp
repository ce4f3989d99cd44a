// SPDX-License-Identifier: Apache-2.0
#include "host/model/lent_deadline.h"

#include <memory>

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using model::nanoseconds;

namespace {

constexpr nanoseconds kNow = 1000ms;

// A task due in 2 s, of which 4 ms were launched, and 30 ms remain.
struct Fixture {
    std::unique_ptr<abi::TaskSlot> slot = std::make_unique<abi::TaskSlot>();
    ug_mark_line line{};

    Fixture() {
        slot->state = abi::TaskState::kGpu;
        slot->deadline_ns = nanoseconds(kNow + 2s).count();
        slot->relative_deadline_ns = nanoseconds(2s).count();
        slot->criticality = 1;
        slot->static_rank = 7;
        slot->launch_ns = slot->progress_ns = kNow.count();
        slot->launched_at_mark_ns[1] = nanoseconds(3ms).count();
        slot->marks_issued = 1;
        slot->launched_ns = nanoseconds(4ms).count();
        slot->head_remaining_ns = nanoseconds(26ms).count();
        slot->later_gpu_ns = nanoseconds(50ms).count();
    }
    bool lend(nanoseconds deadline, nanoseconds until, int criticality = 1,
              nanoseconds executed = 0ms) {
        return model::lend_deadline(*slot, {deadline, until, criticality, 2}, executed);
    }
    void executed_to_mark() {
        line.word[0] = ug_mark_word0(0, 0, 1);
        line.word[1] = 123ull << 16 | 1;
    }
    model::SlotView view(nanoseconds now = kNow) { return model::read_slot(*slot, &line, 3, now); }
};

}  // namespace

TEST_CASE("A lent deadline holds until the work that is waited for has executed",
          "[model][lent_deadline]") {
    Fixture f;
    CHECK(f.view().deadline == kNow + 2s);
    REQUIRE(f.lend(kNow + 15ms, 3ms, 5));
    const model::SlotView lent = f.view();
    CHECK(lent.deadline == kNow + 15ms);
    CHECK(lent.remaining.gpu == 3ms);
    CHECK(lent.later.gpu == 0ms);
    CHECK(lent.laxity == 12ms);
    CHECK(lent.chain.criticality == 5);
    CHECK(lent.chain.static_rank == 2);
    CHECK(lent.ahead.launched == 4ms);  // as much as there is
    f.executed_to_mark();
    CHECK(f.view().deadline == kNow + 2s);
    CHECK(f.view().chain.criticality == 1);
    CHECK(f.view().remaining.gpu == 77ms);
}

TEST_CASE("A later deadline is lent to nobody", "[model][lent_deadline]") {
    Fixture f;
    f.lend(kNow + 3s, 3ms, 5);
    CHECK(f.view().deadline == kNow + 2s);
    CHECK(f.view().chain.criticality == 1);
}

TEST_CASE("A deadline that cannot be met is lent to nobody who can meet its own",
          "[model][lent_deadline]") {
    Fixture f;
    f.lend(kNow + 15ms, 3ms);
    CHECK(f.view(kNow + 12ms).deadline == kNow + 15ms);
    CHECK(f.view(kNow + 12ms + 1ns).deadline == kNow + 2s);
    f.slot->deadline_ns = nanoseconds(kNow + 20ms).count();
    CHECK(f.view(kNow + 30ms).deadline == kNow + 15ms);  // it is late itself
}

TEST_CASE("The earliest of several lent deadlines holds until the last event",
          "[model][lent_deadline]") {
    Fixture f;
    CHECK(f.lend(kNow + 40ms, 4ms, 3));
    CHECK(f.lend(kNow + 15ms, 3ms, 2));
    CHECK_FALSE(f.lend(kNow + 50ms, 2ms));
    CHECK(f.view().deadline == kNow + 15ms);
    CHECK(f.view().chain.criticality == 3);
    CHECK(f.view().remaining.gpu == 4ms);
    CHECK_FALSE(f.lend(kNow + 5ms, 3ms, 9, 3ms));  // executed
    // What has come to its end leaves nothing to the next one.
    CHECK(f.lend(kNow + 90ms, 6ms, 1, 5ms));
    CHECK(model::lent_deadline(*f.slot, 5ms)->deadline == kNow + 90ms);
    CHECK(model::lent_deadline(*f.slot, 5ms)->criticality == 1);
}
