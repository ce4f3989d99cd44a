// SPDX-License-Identifier: Apache-2.0
//
// The paper's ways of knowing the executing kernel (progress/batch_tracking.h), in virtual time:
// what is published when, how often the thread waits, and where it must not.
#include <map>
#include <vector>

#include "host/model/slot_view.h"
#include "tests/support/runtime_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using config::Tracking;

namespace {

// A GPU that executes the launches so far when it has been asked often enough.
struct Fixture : RuntimeFixture {
    int launched = 0;         ///< by all
    int executed = 0;         ///< of those; in one order, that of the launches
    bool gpu_goes_on = true;  ///< while it is asked
    int num_asked = 0, num_created = 0;
    bool relaxed = false, asked_unsafely = false;
    CUresult record_result = CUDA_SUCCESS, query_result = CUDA_SUCCESS;
    std::vector<CUstream> recorded_on;
    bool per_thread = false;  ///< the last event
    std::map<CUevent, int> launches_before;
    inline static Fixture* current = nullptr;

    explicit Fixture(Tracking tracking) {
        current = this;
        resolved.config.scheduler.progress.tracking = tracking;
        driver.api.cuThreadExchangeStreamCaptureMode = [](CUstreamCaptureMode* mode) {
            const bool was =
                std::exchange(current->relaxed, *mode == CU_STREAM_CAPTURE_MODE_RELAXED);
            *mode = was ? CU_STREAM_CAPTURE_MODE_RELAXED : CU_STREAM_CAPTURE_MODE_GLOBAL;
            return CUDA_SUCCESS;
        };
        driver.api.cuEventCreate = [](CUevent* event, unsigned flags) {
            CHECK(flags == CU_EVENT_DISABLE_TIMING);
            CHECK(current->relaxed);
            *event = reinterpret_cast<CUevent>(static_cast<std::uintptr_t>(++current->num_created));
            return CUDA_SUCCESS;
        };
        driver.api.cuEventRecord = [](CUevent event, CUstream stream) {
            current->per_thread = false;
            return current->record(event, stream);
        };
        driver.api.cuEventRecord_ptsz = [](CUevent event, CUstream stream) {
            current->per_thread = true;
            return current->record(event, stream);
        };
        driver.api.cuEventQuery = [](CUevent event) {
            Fixture& f = *current;
            ++f.num_asked;
            f.asked_unsafely = f.asked_unsafely || !f.relaxed;
            if (f.query_result != CUDA_SUCCESS) return f.query_result;
            if (f.launches_before.at(event) <= f.executed) return CUDA_SUCCESS;
            if (f.gpu_goes_on) ++f.executed;
            return CUDA_ERROR_NOT_READY;
        };
    }
    ~Fixture() {
        CHECK_FALSE(asked_unsafely);
        CHECK_FALSE(relaxed);
        CHECK(driver.marks.empty());
        current = nullptr;
    }

    CUresult record(CUevent event, CUstream stream) {
        CHECK((!stream || stream != driver.capturing));
        if (record_result != CUDA_SUCCESS) return record_result;
        recorded_on.push_back(stream);
        launches_before[event] = launched;
        return CUDA_SUCCESS;
    }

    Grant launch_as(Launch l, ThreadState* thread = nullptr) {
        ThreadState& t = thread ? *thread : thread_a;
        CHECK_FALSE(rt().planned().goes(t, l));
        const Grant g = rt().launches().before(t, l);
        ++launched;
        clock.advance(10us);
        if (g.task) rt().launches().after(t, l, g, true);
        return g;
    }
    void launches(int count, CUstream stream = kStreamA) {
        for (; count > 0; --count) launch_as({kConv, 100, 256, stream});
    }
    /// Of the task `tight`, as others read it.
    runtime::TaskState& task() { return *thread_a.task; }
    model::SlotView view() {
        return model::read_slot(*task().slot, task().line, task().index, clock.now());
    }
    const ug_mark_line& line() { return *task().line.load(); }
    std::uint64_t published_position() { return line().word[0] >> 32; }
    std::uint64_t waits(int chain = 0) { return stats(chain).synchronisations; }
};

}  // namespace

TEST_CASE("sync: every launch is known to have executed before the next", "[tracking]") {
    Fixture f(Tracking::kSync);
    f.begin(f.thread_a, "tight");
    for (int n = 1; n <= 3; ++n) {
        f.launches(1);
        CHECK(f.executed == n);
        CHECK(f.waits() == std::uint64_t(n));
        CHECK(f.published_position() == std::uint64_t(n));
        CHECK(f.line().word[1] >> 16 == std::uint64_t(f.clock.now().count()));
        CHECK(f.line().clock == UG_MARK_CLOCK_HOST);
        CHECK(f.view().ahead.launched == 0ns);
        CHECK(f.view().remaining.gpu == (20 - n) * 100us);
    }
    CHECK(f.recorded_on == std::vector(3, kStreamA));
    CHECK(f.num_created == 2);
    CHECK(f.stats(0).tasks.marks == 0);
    f.wait(f.thread_a, kStreamA);
    CHECK(f.waits() == 3);
    CHECK(f.clock.num_sleeps == 0);
}

TEST_CASE("batched: the thread waits after every batch", "[tracking]") {
    Fixture f(Tracking::kBatched);
    SECTION("of the default length") {}
    SECTION("of another length") {
        f.resolved.config.scheduler.progress.eval_interval = 200us;
    }
    const int batch = f.resolved.config.scheduler.progress.eval_interval / 100us;
    f.begin(f.thread_a, "tight");
    for (int n = 1; n <= 3 * batch; ++n) {
        f.launches(1);
        const int known = n / batch * batch;
        CHECK(f.executed == known);
        CHECK(f.waits() == std::uint64_t(n / batch));
        CHECK(f.published_position() == std::uint64_t(known));
        CHECK(f.view().ahead.launched == (n - known) * 100us);
        CHECK(f.view().remaining.gpu == (20 - known) * 100us);
    }
}

TEST_CASE("overlapped: a batch executes while the next is launched", "[tracking]") {
    Fixture f(Tracking::kOverlapped);
    f.begin(f.thread_a, "tight");
    f.launches(10);
    CHECK(f.recorded_on.size() == 2);
    CHECK(f.num_asked == 0);
    CHECK(f.view().ahead.launched == 1ms);
    f.launches(1);  // the first of the third batch
    CHECK(f.executed == 5);
    CHECK(f.waits() == 1);
    CHECK(f.published_position() == 5);
    CHECK(f.view().ahead.launched == 600us);
    f.launches(4);
    CHECK(f.recorded_on.size() == 3);
    CHECK(f.waits() == 1);
    f.launches(1);
    CHECK(f.executed == 10);
    CHECK(f.waits() == 2);
    CHECK(f.published_position() == 10);
    CHECK(f.num_created == 2);
}

TEST_CASE("async: what has been launched counts as executed, and is there until the program waits",
          "[tracking]") {
    Fixture f(Tracking::kAsync);
    f.begin(f.thread_a, "tight");
    for (int segment = 0; segment < 2; ++segment) {
        const int before = 8 * segment;
        for (int n = 1; n <= 8; ++n) {
            f.launches(1);
            CHECK(f.view().ahead.launched == 1ns);
            CHECK(f.view().remaining.gpu == (20 - n) * 100us + 1ns);
        }
        f.clock.advance(2500us);  // twice what was launched, and 1 ms, are not over
        CHECK(f.view().state.blocking);
        f.clock.advance(200us);
        CHECK(f.view().state.ranked);
        CHECK_FALSE(f.view().state.blocking);
        CHECK(f.published_position() == std::uint64_t(before));
        f.wait(f.thread_a, kStreamA);
        CHECK_FALSE(f.view().state.ranked);
        CHECK(f.published_position() == std::uint64_t(before + 8));
    }
    CHECK(f.waits() == 0);
    CHECK(f.recorded_on.empty());
    CHECK(f.num_asked == 0);
}

TEST_CASE("Positions tell what a way of tracking knows, and not what time may have brought",
          "[tracking]") {
    const auto [tracking, known] =
        GENERATE(std::pair{Tracking::kAsync, 11u}, std::pair{Tracking::kSync, 11u},
                 std::pair{Tracking::kBatched, 10u}, std::pair{Tracking::kOverlapped, 5u});
    CAPTURE(tracking);
    Fixture f(tracking);
    f.begin(f.thread_a, "tight");
    f.launches(11);
    for (int i = 0; i < 3; ++i) {
        const auto found = f.rt().progress().position("tight", "detect");
        REQUIRE(found);
        CHECK(found->at.position == known);
        CHECK(found->remaining == (20 - known) * 100us);
        f.clock.advance(150us);
    }
}

TEST_CASE("The program's own wait tells that all has executed", "[tracking]") {
    Fixture f(GENERATE(Tracking::kBatched, Tracking::kOverlapped));
    f.begin(f.thread_b, "loose");
    f.launch_as({kConv, 100, 256, kStreamB}, &f.thread_b);  // somebody who looks
    f.begin(f.thread_a, "tight");
    f.launches(7);
    const auto waits = f.waits();
    f.wait(f.thread_a, kStreamA);
    f.executed = f.launched;
    CHECK(f.waits() == waits);
    CHECK(f.published_position() == 7);
    f.launches(1);
    CHECK(f.view().ahead.launched == 100us);
}

TEST_CASE("Run-ahead has no bound but the batch, and every launch is asked about", "[tracking]") {
    Fixture f(GENERATE(Tracking::kAsync, Tracking::kBatched, Tracking::kOverlapped));
    f.resolved.config.scheduler.progress.eval_interval = 5ms;
    for (auto& chain : f.resolved.profile->chains)
        chain.tasks[0].segments = {{1ms, 20, 20, 20, "stream"}};
    f.begin(f.thread_a, "tight");
    f.launches(20);  // which looks that none of them went as planned
    CHECK(f.clock.num_sleeps == 0);
    CHECK(f.waits() == 0);
    CHECK(f.stats(0).tasks.scheduled == 20);
}

TEST_CASE("Nothing of ours gets into a capture", "[tracking]") {
    Fixture f(
        GENERATE(Tracking::kAsync, Tracking::kSync, Tracking::kBatched, Tracking::kOverlapped));
    f.begin(f.thread_a, "tight");
    f.launches(1);
    const auto recorded = f.recorded_on.size();
    const int asked = f.num_asked;
    f.rt().streams().capture_begins(kStreamA, exec::StreamFlavor::kLegacy);
    f.driver.capturing = kStreamA;
    f.launches(12);
    CHECK(f.recorded_on.size() == recorded);
    CHECK(f.num_asked == asked);
}

TEST_CASE("A launch between two timing events is not waited for before the second", "[tracking]") {
    Fixture f(Tracking::kSync);
    f.begin(f.thread_a, "tight");
    f.rt().waits().event_recorded(f.thread_a, reinterpret_cast<CUevent>(0xe), kStreamA,
                                  exec::StreamFlavor::kLegacy, true);
    f.launches(1);
    CHECK(f.waits() == 0);
    f.launches(1);  // which waits for that one before, and for itself after
    CHECK(f.waits() == 2);
    CHECK(f.published_position() == 2);
}

TEST_CASE("overlapped: no wait between a timing event and the launch that it times", "[tracking]") {
    Fixture f(Tracking::kOverlapped);
    f.begin(f.thread_a, "tight");
    f.launches(10);
    f.rt().waits().event_recorded(f.thread_a, reinterpret_cast<CUevent>(0xe), kStreamA,
                                  exec::StreamFlavor::kLegacy, true);
    f.launches(1);
    CHECK(f.num_asked == 0);
    f.launches(1);
    CHECK(f.published_position() == 5);
}

TEST_CASE("Launches that depend on each other programmatically are not waited for", "[tracking]") {
    Fixture f(GENERATE(Tracking::kSync, Tracking::kBatched, Tracking::kOverlapped));
    f.begin(f.thread_a, "tight");
    Launch launch{kConv, 100, 256, kStreamA};
    launch.depends_on_previous = true;
    for (int i = 0; i < 12; ++i) f.launch_as(launch);
    CHECK(f.recorded_on.empty());
    CHECK(f.num_asked == 0);
}

TEST_CASE("Per-thread default stream is recorded on by its own entry point", "[tracking]") {
    Fixture f(Tracking::kSync);
    f.begin(f.thread_a, "tight");
    f.launch_as({kConv, 100, 256, nullptr, exec::StreamFlavor::kPerThread});
    CHECK(f.per_thread);
    CHECK(f.waits() == 1);
}

TEST_CASE("A wait that the GPU does not end is given up after the instance's bound", "[tracking]") {
    Fixture f(GENERATE(Tracking::kSync, Tracking::kBatched, Tracking::kOverlapped));
    f.resolved.config.scheduler.hold.max_per_instance = 3ms;
    f.gpu_goes_on = false;  // it waits for what the thread does later
    f.begin(f.thread_a, "tight");
    const auto begin = f.clock.now();
    f.launches(20);
    CHECK(f.clock.now() - begin >= 3ms);
    CHECK(f.clock.now() - begin <= 3ms + 20 * 10us + 100us);
    CHECK(f.waits() == 1);
    CHECK(f.stats(0).tasks.holds_opened == 1);
    CHECK(f.stats(0).tasks.launches == 20);
    CHECK(f.stats(0).tasks.scheduled == 20);
    CHECK(f.published_position() == 0);
    f.rt().frames().task_end(f.thread_a);
    f.gpu_goes_on = true;
    f.begin(f.thread_a, "tight");
    f.launches(12);
    CHECK(f.waits() >= 2);
    CHECK(f.published_position() >= 5);
    CHECK(f.view().ahead.launched <= 1ms);
}

TEST_CASE("Batches that nobody ever sees to end take no progress for granted", "[tracking]") {
    Fixture f(GENERATE(Tracking::kAsync, Tracking::kSync, Tracking::kOverlapped));
    f.resolved.config.scheduler.hold.max_per_instance = 1ms;
    f.gpu_goes_on = false;
    for (int run = 0; run < 300; ++run) {
        f.begin(f.thread_a, "tight");
        f.launches(11);
        CHECK(f.published_position() == 0);
        CHECK(f.task().slot->marks_issued.load() <= 40);
        f.rt().frames().task_end(f.thread_a);
    }
}

TEST_CASE("Switching UrgenGo off ends a wait", "[tracking]") {
    Fixture f(Tracking::kSync);
    f.gpu_goes_on = false;
    f.begin(f.thread_a, "tight");
    f.clock.on_sleep = [&] { f.rt().steering().set_mode(config::Mode::kOff); };
    f.launches(1);
    CHECK(f.clock.num_sleeps == 1);
    CHECK(f.stats(0).tasks.holds_opened == 0);
}

TEST_CASE("In shadow the thread waits for no batch, and asks a few times", "[tracking]") {
    Fixture f(GENERATE(Tracking::kSync, Tracking::kBatched, Tracking::kOverlapped));
    f.rt().steering().set_mode(config::Mode::kShadow);
    f.begin(f.thread_a, "tight");
    f.gpu_goes_on = false;
    f.launches(20);
    CHECK(f.num_asked <= 3 * 20);
    CHECK(f.clock.num_sleeps == 0);
    CHECK(f.waits() == 0);
    f.executed = f.launched;
    f.launches(10);
    CHECK(f.published_position() >= 10);
}

TEST_CASE("A driver that refuses ends the scheduling of the instance", "[tracking]") {
    Fixture f(GENERATE(Tracking::kSync, Tracking::kBatched, Tracking::kOverlapped));
    SECTION("to record") {
        f.record_result = CUDA_ERROR_INVALID_HANDLE;
    }
    SECTION("to answer") {
        f.query_result = CUDA_ERROR_ILLEGAL_ADDRESS;
    }
    f.begin(f.thread_a, "tight");
    f.launches(12);
    CHECK(f.stats(0).tasks.marks_refused == 1);
    CHECK(f.stats(0).tasks.launches == 12);
    CHECK(f.stats(0).tasks.scheduled < 12);
    CHECK(f.published_position() == 0);
}

TEST_CASE("In another context the waits have events of that context", "[tracking]") {
    Fixture f(Tracking::kBatched);
    f.begin(f.thread_a, "tight");
    f.launches(5);
    CHECK(f.num_created == 1);
    f.driver.context = reinterpret_cast<CUcontext>(0x43);
    f.launches(5, nullptr);
    CHECK(f.num_created == 2);
    CHECK(f.waits() == 2);
    f.driver.context = reinterpret_cast<CUcontext>(0x42);
    f.launches(10);
    CHECK(f.num_created == 3);  // the second of the first context's two
    CHECK(f.view().ahead.launched == 0ns);
}

TEST_CASE("Who is held knows how far the GPU is with what it has launched", "[tracking]") {
    const auto tracking = GENERATE(Tracking::kBatched, Tracking::kOverlapped);
    Fixture f(tracking);
    f.begin(f.thread_b, "loose");
    const Launch b{kConv, 100, 256, kStreamB};
    for (int i = 0; i < 3; ++i) f.launch_as(b, &f.thread_b);
    f.begin(f.thread_a, "tight");
    f.launches(3);
    CHECK(f.waits(1) == 0);
    f.clock.on_sleep = [&] {
        CHECK(f.waits(1) == 1);
        CHECK(f.thread_b.at_task->line.load()->word[0] >> 32 == 3);
        // Only now is it known of the one that it is held for.
        if (f.clock.num_sleeps == 3) f.wait(f.thread_a, kStreamA);
    };
    f.launch_as(b, &f.thread_b);
    CHECK(f.clock.num_sleeps == 3);
    CHECK(f.stats(1).tasks.holds == 1);
}
