// SPDX-License-Identifier: Apache-2.0
//
// Copies by themselves (host/runtime/copies.h): around them a driver whose events are over when the
// test says so. How they get on with a copy engine: test_runtime_copies.cpp.
#include "host/runtime/copies.h"

#include <fstream>
#include <functional>
#include <set>
#include <vector>

#include "tests/support/fake_memory.h"
#include "tests/support/folder.h"
#include "tests/support/runtime_parts.h"

using namespace urgengo;
using namespace urgengo::testing;
using runtime::Copies;
using runtime::Copy;
using runtime::CopyTurn;
using runtime::TaskState;
using runtime::ThreadState;

namespace {

constexpr std::size_t kSlice = 8 * kMiB;
const CUstream kStream = reinterpret_cast<CUstream>(0xa0),
               kOther = reinterpret_cast<CUstream>(0xb0);

config::Config config_of(bool hold, std::size_t slice_bytes) {
    config::Config config = RuntimeParts::two_chains();
    config.scheduler.copies.hold = hold;
    config.scheduler.copies.slice_bytes =
        static_cast<decltype(config.scheduler.copies.slice_bytes)>(slice_bytes);
    return config;
}

/// Every copy is of `task`, and its thread may take it.
struct Threads final : runtime::CopyingThreads {
    TaskState* copying_task(ThreadState&) override { return task; }
    bool take_own(ThreadState&, TaskState& its) override {
        num_taken += may_take;
        return may_take && &its == task;
    }
    void release(ThreadState&) override { ++num_released; }

    TaskState* task = nullptr;
    bool may_take = true;
    int num_taken = 0, num_released = 0;
};

struct TaskCopiesTest : RuntimeParts {
    explicit TaskCopiesTest(bool hold = true, std::size_t slice_bytes = kSlice,
                            bool may_hold = true)
        : RuntimeParts(config_of(hold, slice_bytes)),
          copies(config_of(hold, slice_bytes).scheduler, may_hold,
                 {driver.api, clock, captures, marks, governor, guard, tasks, records}, threads) {
        current = this;
        threads.task = tasks[1].get();
        answer_of_memory(driver.api);
        driver.api.cuEventCreate = [](CUevent* event, unsigned) {
            *event = reinterpret_cast<CUevent>(++current->num_events);
            return CUDA_SUCCESS;
        };
        driver.api.cuEventRecord = [](CUevent event, CUstream) {
            if (current->record_result == CUDA_SUCCESS) current->under_way.insert(event);
            return current->record_result;
        };
        driver.api.cuEventRecord_ptsz = driver.api.cuEventRecord;
        driver.api.cuEventQuery = [](CUevent event) {
            if (current->query_error != CUDA_SUCCESS) return current->query_error;
            return current->under_way.count(event) ? CUDA_ERROR_NOT_READY : CUDA_SUCCESS;
        };
        driver.is_over = [] { return true; };  // streams are idle
        begin(0);
        begin(1);
    }
    ~TaskCopiesTest() { current = nullptr; }

    static Copy copy_of(std::size_t bytes) { return {kDevice, kHost, bytes, kStream}; }
    CopyTurn turn_of(std::size_t bytes) { return copies.begin(thread, copy_of(bytes)); }
    /// A copy of `tight` is at the engine, until the test says that its event is over.
    void urgent_copies() {
        TaskState* const loose = std::exchange(threads.task, tasks[0].get());
        CopyTurn turn = copies.begin(urgent, copy_of(kMiB));
        REQUIRE(turn.holds);
        copies.before_slice(urgent, copy_of(kMiB), turn);
        copies.after_slice(urgent, copy_of(kMiB), turn, kMiB);
        copies.end(turn);
        threads.task = loose;
    }
    /// The next slice of the copy. @returns how long it waited
    nanoseconds slice(const Copy& copy, CopyTurn& turn) {
        const nanoseconds begin = clock.now();
        copies.before_slice(thread, copy, turn);
        copies.after_slice(thread, copy, turn, turn.slice ? turn.slice : copy.bytes);
        return clock.now() - begin;
    }
    std::int64_t held_ns() { return tasks[1]->counters.held_ns; }

    Threads threads;
    ThreadState thread, urgent;
    exec::Captures captures{driver.api};
    exec::ProgressMarks marks{driver.api};
    CUresult record_result = CUDA_SUCCESS, query_error = CUDA_SUCCESS;
    std::uintptr_t num_events = 0;
    std::set<CUevent> under_way;
    Folder folder;
    observe::StatusPage page{{}, two_chains(), 0ns};
    runtime::RunRecords records{
        {folder.path("run"), observe::kFlightRecords, ""}, {}, page, two_chains()};
    Copies copies;

    inline static TaskCopiesTest* current = nullptr;

    /// The first thread's records.
    std::vector<abi::RunRecord> recorded() const {
        std::ifstream file(folder.path("run"), std::ios::binary);
        abi::RunHeader header{};
        abi::RunRing ring{};
        file.read(reinterpret_cast<char*>(&header), sizeof header);
        file.seekg(static_cast<std::streamoff>(header.rings.offset));
        file.read(reinterpret_cast<char*>(&ring), sizeof ring);
        std::vector<abi::RunRecord> records_read(ring.written);
        file.read(reinterpret_cast<char*>(records_read.data()),
                  static_cast<std::streamsize>(ring.written * sizeof(abi::RunRecord)));
        return records_read;
    }
};

}  // namespace

TEST_CASE("Copies are left alone unless the config asks for something", "[runtime][copies]") {
    CHECK_FALSE(TaskCopiesTest(false, 0).copies.changes_any());
    CHECK(TaskCopiesTest(true, 0).copies.changes_any());
    CHECK(TaskCopiesTest(false, kSlice).copies.changes_any());
    CHECK(TaskCopiesTest(true, 0, false).copies.changes_any());  // where there are several chains
    CHECK(TaskCopiesTest(false, 0).turn_of(100 * kMiB).task == nullptr);
}

TEST_CASE("A copy is left alone where nothing may become of it", "[runtime][copies]") {
    TaskCopiesTest f;
    REQUIRE(f.turn_of(kMiB).task != nullptr);
    f.tasks[1]->copies.busy = false;
    SECTION("of no bytes") {
        CHECK(f.turn_of(0).task == nullptr);
    }
    SECTION("of no task") {
        f.threads.task = nullptr;
        CHECK(f.turn_of(100 * kMiB).task == nullptr);
    }
    SECTION("while UrgenGo only observes") {
        f.governor.steered().set(config::Mode::kObserve);
        CHECK(f.turn_of(100 * kMiB).task == nullptr);
    }
    SECTION("of a chain that is only observed") {
        f.chains[1]->config.mode = config::Mode::kObserve;
        CHECK(f.turn_of(100 * kMiB).task == nullptr);
    }
    SECTION("that is captured") {
        f.captures.began(kStream, exec::StreamFlavor::kLegacy);
        f.driver.capturing = kStream;
        CHECK(f.turn_of(100 * kMiB).task == nullptr);
    }
    CHECK_FALSE(f.tasks[1]->copies.busy);
    CHECK(f.tasks[1]->copies.num_cut == 0);
}

TEST_CASE("A large copy is cut, and held no more than the config says", "[runtime][copies]") {
    const bool hold = GENERATE(false, true), may_hold = GENERATE(false, true);
    TaskCopiesTest f(hold, kSlice, may_hold);
    const CopyTurn large = f.turn_of(64 * kMiB);
    REQUIRE(large.task == f.tasks[1].get());
    CHECK(large.slice == kSlice);
    CHECK(large.holds == (hold && may_hold));
    CHECK(large.paces == (hold && may_hold));
    CHECK(f.tasks[1]->copies.num_cut == 1);
    CHECK(f.tasks[1]->copies.busy == large.holds);
    f.tasks[1]->copies.busy = false;
    const CopyTurn small = f.turn_of(kSlice);
    CHECK(small.slice == 0);
    CHECK((small.task != nullptr) == (hold && may_hold));
    CHECK(f.tasks[1]->copies.num_cut == 1);
}

TEST_CASE("A copy on the device is neither held nor paced", "[runtime][copies]") {
    TaskCopiesTest f;
    const Copy copy{kDevice + 512 * kMiB, kDevice, 512 * kMiB, kStream};
    const CopyTurn turn = f.copies.begin(f.thread, copy);
    CHECK(turn.slice > kSlice);
    CHECK_FALSE(turn.holds);
    CHECK_FALSE(f.tasks[1]->copies.busy);
}

TEST_CASE("One copy of a task at a time is held, until it ends", "[runtime][copies]") {
    TaskCopiesTest f;
    CopyTurn first = f.turn_of(64 * kMiB);
    CopyTurn second = f.turn_of(64 * kMiB);
    CHECK(first.holds);
    CHECK_FALSE(second.holds);
    CHECK(second.slice == kSlice);  // cut it is
    CHECK(f.turn_of(kMiB).task == nullptr);
    Copies::end(second);
    CHECK(f.tasks[1]->copies.busy);
    Copies::end(first);
    Copies::end(first);
    CHECK_FALSE(f.tasks[1]->copies.busy);
    CHECK(f.turn_of(64 * kMiB).holds);
}

TEST_CASE("Others see that a copy comes, and that nothing came of it", "[runtime][copies]") {
    TaskCopiesTest f;
    const Copy copy = TaskCopiesTest::copy_of(64 * kMiB);
    CopyTurn turn = f.copies.begin(f.thread, copy);
    const auto& published = f.tasks[1]->copies.published;
    CHECK_FALSE(published.may_be_any(f.clock.now()));
    f.copies.before_slice(f.thread, copy, turn);
    CHECK(published.may_be_any(f.clock.now()));
    Copies::end(turn);  // the driver refused it
    CHECK_FALSE(published.may_be_any(f.clock.now()));
    CHECK(f.thread.copied.task == nullptr);
}

TEST_CASE("Two slices of a copy are under way at most", "[runtime][copies]") {
    TaskCopiesTest f;
    const Copy copy = TaskCopiesTest::copy_of(64 * kMiB);
    CopyTurn turn = f.copies.begin(f.thread, copy);
    CHECK(f.slice(copy, turn) == 0ns);
    CHECK(f.slice(copy, turn) == 0ns);
    REQUIRE(f.under_way.size() == 2);
    SECTION("The third waits until the first is over") {
        f.clock.on_sleep = [&] {
            if (f.clock.num_sleeps == 3) f.under_way.erase(f.under_way.begin());
        };
        CHECK(f.slice(copy, turn) > 0ns);
        CHECK(f.clock.num_sleeps == 3);
        CHECK(f.under_way.size() == 2);
        CHECK(turn.paces);
    }
    SECTION("The rest goes at once when that takes too long") {
        const nanoseconds waited = f.slice(copy, turn);
        CHECK(waited > 2 * sched::copy_time(kSlice, sched::kSlowGbps));
        CHECK(waited < 5ms);
        CHECK_FALSE(turn.paces);
        CHECK(f.slice(copy, turn) == 0ns);
    }
    SECTION("or when UrgenGo is switched off") {
        f.clock.on_sleep = [&] { f.governor.steered().set(config::Mode::kOff); };
        f.slice(copy, turn);
        CHECK(f.clock.num_sleeps == 1);
        CHECK_FALSE(turn.paces);
    }
    SECTION("or when the driver cannot say") {
        f.query_error = CUDA_ERROR_ILLEGAL_ADDRESS;
        CHECK(f.slice(copy, turn) == 0ns);
        CHECK_FALSE(turn.paces);
    }
    SECTION("or when there is no event behind it") {
        f.under_way.clear();
        f.record_result = CUDA_ERROR_INVALID_HANDLE;
        CHECK(f.slice(copy, turn) == 0ns);
        CHECK_FALSE(turn.paces);
        CHECK(turn.context == nullptr);
        CHECK(f.slice(copy, turn) == 0ns);
    }
}

TEST_CASE("A copy waits while a more urgent task has one at the engine", "[runtime][copies]") {
    TaskCopiesTest f;
    f.urgent_copies();
    const Copy copy = TaskCopiesTest::copy_of(kMiB);
    CopyTurn turn = f.copies.begin(f.thread, copy);
    SECTION("until it is over") {
        f.clock.on_sleep = [&] {
            if (f.clock.num_sleeps == 5) f.under_way.clear();
        };
        CHECK(f.slice(copy, turn) > 0ns);
        CHECK(f.clock.num_sleeps == 5);
        CHECK(f.tasks[1]->counters.holds == 1);
        CHECK(f.threads.num_taken == 1);
        CHECK(f.threads.num_released == 1);
        CHECK(f.tasks[1]->taking.held_frame == nullptr);
        const std::vector<abi::RunRecord> records = f.recorded();
        REQUIRE(records.size() == 2);
        CHECK(records[0].kind == abi::RunKind::kHoldBegin);
        CHECK(records[1].kind == abi::RunKind::kHoldEnd);
        CHECK(records[1].flags == abi::kRunCopy);
        CHECK(records[1].task == 1);
        CHECK(records[1].time_ns - records[1].begin_ns == f.tasks[1]->counters.held_ns);
    }
    SECTION("or the program has waited for it") {
        f.clock.on_sleep = [&] {
            runtime::Wait wait;
            wait.stream = kStream;
            Copies::waited_for(f.urgent, wait);
        };
        f.slice(copy, turn);
        CHECK(f.clock.num_sleeps == 1);
    }
    SECTION("or UrgenGo is switched off") {
        f.clock.on_sleep = [&] { f.governor.steered().set(config::Mode::kOff); };
        f.slice(copy, turn);
        CHECK(f.clock.num_sleeps == 1);
    }
    SECTION("for its bound, if it does not end") {
        const nanoseconds bound = f.governor.hold_bound(*f.tasks[1]);
        const nanoseconds waited = f.slice(copy, turn);
        CHECK(waited > 0ns);
        CHECK(waited <= std::max(bound, sched::copy_bound(1ms)));
    }
    SECTION("but not between two events that take the time") {
        f.thread.measuring = true;
        CHECK(f.slice(copy, turn) == 0ns);
    }
    SECTION("nor if somebody else is at its task") {
        f.threads.may_take = false;
        CHECK(f.slice(copy, turn) == 0ns);
        CHECK(f.threads.num_released == 0);
    }
    SECTION("nor if its run is only observed") {
        f.tasks[1]->run.observed = true;
        CHECK(f.slice(copy, turn) == 0ns);
    }
    if (f.clock.num_sleeps == 0) {
        CHECK(f.held_ns() == 0);
        CHECK(f.tasks[1]->counters.holds == 0);
    } else {
        CHECK(f.held_ns() > 0);
        CHECK(f.tasks[1]->run.waited.held.count() == f.held_ns());
    }
}

TEST_CASE("The more urgent task's copy waits for nobody", "[runtime][copies]") {
    TaskCopiesTest f;
    f.urgent_copies();
    CopyTurn turn = f.turn_of(kMiB);
    f.under_way.clear();
    CHECK(f.slice(TaskCopiesTest::copy_of(kMiB), turn) == 0ns);
    Copies::end(turn);
    f.urgent_copies();
    CHECK(f.clock.num_sleeps == 0);
}

TEST_CASE("A thread's last copy is over with the wait that is for it", "[runtime][copies]") {
    using abi::TraceWait;
    const auto is_over_after = [](TraceWait function, CUstream stream,
                                  exec::StreamFlavor flavor = exec::StreamFlavor::kLegacy) {
        TaskCopiesTest f;
        f.urgent_copies();
        REQUIRE(f.urgent.copied.task == f.tasks[0].get());
        runtime::Wait wait;
        wait.function = function;
        wait.stream = stream;
        wait.flavor = flavor;
        Copies::waited_for(f.urgent, wait);
        const bool is_over = f.urgent.copied.task == nullptr;
        CHECK(f.tasks[0]->copies.published.may_be_any(f.clock.now()) == !is_over);
        return is_over;
    };
    CHECK(is_over_after(TraceWait::kStream, kStream));
    CHECK(is_over_after(TraceWait::kStreamQuery, kStream));
    CHECK(is_over_after(TraceWait::kCopy, kStream));
    CHECK(is_over_after(TraceWait::kContext, nullptr));
    CHECK_FALSE(is_over_after(TraceWait::kStream, kOther));
    CHECK_FALSE(is_over_after(TraceWait::kEvent, kStream));
    // A handle is of one stream, whatever the call's flavour.
    CHECK(is_over_after(TraceWait::kStream, kStream, exec::StreamFlavor::kPerThread));
}
