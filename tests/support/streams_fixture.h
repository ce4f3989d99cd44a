// SPDX-License-Identifier: Apache-2.0
//
// A runtime with tasks over several streams: a trunk, and sides that fork from it and join it.
#pragma once

#include <algorithm>

#include "tests/support/runtime_fixture.h"

namespace urgengo::testing {

inline const CUstream kTrunk = kStreamA;
inline const CUevent kFork = reinterpret_cast<CUevent>(0xe00);

inline CUstream side(int i) {
    return reinterpret_cast<CUstream>(static_cast<std::uintptr_t>(0x1000 + 0x10 * i));
}
inline CUevent joined(int i) {
    return reinterpret_cast<CUevent>(static_cast<std::uintptr_t>(0xe10 + 0x10 * i));
}

struct StreamsFixture : RuntimeFixture {
    void record(CUevent event, CUstream stream) {
        rt().waits().event_recorded(thread_a, event, stream, exec::StreamFlavor::kLegacy, false);
    }
    void wait_for(CUstream stream, CUevent event) {
        rt().work_on_streams().stream_waits(thread_a, stream, exec::StreamFlavor::kLegacy, event);
    }
    void fork(int streams) {
        record(kFork, kTrunk);
        for (int i = 0; i < streams; ++i) wait_for(side(i), kFork);
    }
    void join(int streams) {
        for (int i = 0; i < streams; ++i) {
            record(joined(i), side(i));
            wait_for(kTrunk, joined(i));
        }
    }
    void launch_on_sides(int streams, int each) {
        for (int k = 0; k < each; ++k)
            for (int i = 0; i < streams; ++i) launch(thread_a, side(i));
    }
    /// `loose` is at work, so that `tight` has company, and `tight` begins.
    void begin_beside_loose() {
        begin(thread_b, "loose");
        launch(thread_b, kStreamB);
        begin(thread_a, "tight");
    }
    bool closes(CUstream stream) { return begin_wait(thread_a, stream).for_all; }
    bool closes(CUevent event) {
        runtime::Wait wait;
        wait.function = abi::TraceWait::kEvent;
        wait.event = event;
        rt().waits().before(thread_a, wait);
        return wait.for_all;
    }
    std::chrono::nanoseconds remaining_of_a() {
        const runtime::TaskState& task = *thread_a.task;
        return model::read_slot(*task.slot, task.line.load(), task.index, clock.now())
            .remaining.gpu;
    }
    /// While 2 ms of work go by time: all of it is left at first, half of it after half.
    void see_two_ms_go_by() {
        CHECK(remaining_of_a() > std::chrono::microseconds(1900));
        clock.advance(std::chrono::milliseconds(1));
        CHECK(remaining_of_a() > std::chrono::microseconds(900));
        CHECK(remaining_of_a() <= std::chrono::milliseconds(1));
        clock.advance(std::chrono::milliseconds(1));
    }
    /// Marks that are under way and vouch for all that was launched.
    int marks() const {
        return static_cast<int>(
            std::count_if(driver.marks.begin(), driver.marks.end(),
                          [](const PendingMark& m) { return !m.is_of_branch(); }));
    }
    int branch_marks() const { return static_cast<int>(driver.marks.size()) - marks(); }
    /// Those of them that were launched on `stream`.
    int marks_on(CUstream stream) const {
        return static_cast<int>(std::count_if(
            driver.marks.begin(), driver.marks.end(),
            [=](const PendingMark& m) { return !m.is_of_branch() && m.stream == stream; }));
    }
};

}  // namespace urgengo::testing
