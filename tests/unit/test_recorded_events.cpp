// SPDX-License-Identifier: Apache-2.0
#include "host/progress/recorded_events.h"

#include <memory>

#include "tests/support/catch.h"

using namespace std::chrono_literals;
using urgengo::progress::RecordedEvent;
using urgengo::progress::RecordedEvents;

namespace {

const void* event(std::uintptr_t i) {
    return reinterpret_cast<const void*>(0x1000 + 0x40 * i);
}

}  // namespace

TEST_CASE("RecordedEvents knows what an event was recorded behind last",
          "[progress][recorded_events]") {
    const auto events = std::make_unique<RecordedEvents>();
    CHECK_FALSE(events->find(event(1)));
    CHECK_FALSE(events->find(nullptr));
    RecordedEvent record{.task = 3, .covered = {.all = 7, .on = {}}, .gpu_time = 5ms};
    record.covered.on[2] = 9;
    events->recorded(event(1), record);
    auto found = events->find(event(1));
    REQUIRE(found);
    CHECK(found->task == 3);
    CHECK(found->gpu_time == 5ms);
    CHECK(found->covered.all == 7);
    CHECK(found->covered.on[2] == 9);

    events->recorded(event(1), {.task = 4, .covered = {.all = 8, .on = {}}, .gpu_time = 6ms});
    found = events->find(event(1));
    REQUIRE(found);
    CHECK(found->task == 4);
    CHECK(found->covered.on[2] == 0);
    events->forget(event(1));
    CHECK_FALSE(events->find(event(1)));
    events->forget(event(1));
}

TEST_CASE("RecordedEvents keeps the latest when there are too many",
          "[progress][recorded_events]") {
    const auto events = std::make_unique<RecordedEvents>();
    constexpr std::uintptr_t kMany = 5000;
    for (std::uintptr_t i = 0; i < kMany; ++i)
        events->recorded(event(i),
                         {.task = static_cast<int>(i % 64), .covered = {}, .gpu_time = {}});
    for (std::uintptr_t i = 0; i < kMany; ++i)
        if (const auto found = events->find(event(i)))
            CHECK(found->task == static_cast<int>(i % 64));
    CHECK(events->find(event(kMany - 1)));
    for (std::uintptr_t i = kMany - 50; i < kMany; ++i) CHECK(events->find(event(i)));
}
