// SPDX-License-Identifier: Apache-2.0
//
// Launches behind gates, and who opens them.
#include "host/runtime/gates.h"

#include "tests/support/gates_fixture.h"
#include "tests/support/nvtx_tool.h"

using namespace urgengo;
using namespace urgengo::testing;
using std::chrono::nanoseconds;

TEST_CASE("A launch that would have to wait goes behind a gate, and its thread goes on",
          "[runtime][gates]") {
    GatesFixture f;
    const Grant grant = f.launch_on(f.thread_b, kStreamB);
    CHECK(grant.scheduled);
    CHECK(f.clock.num_sleeps == 0);
    REQUIRE(GatesFixture::closed.size() == 1);
    CHECK(GatesFixture::closed[0].stream == kStreamB);
    CHECK(GatesFixture::closed[0].value == f.slot().gates_closed);
    CHECK(GatesFixture::closed[0].word == reinterpret_cast<CUdeviceptr>(&f.slot().gates_opened));
    CHECK(f.is_closed());
    CHECK(f.loose().counters.holds == 1);
    CHECK(f.poller.num_wakes > 0);
    CHECK(f.driver.marks.back().stream == kStreamB);  // it tells of the gate
}

TEST_CASE("Launches behind a closed gate form groups, each behind a gate of its own",
          "[runtime][gates]") {
    GatesFixture f;  // kernels of 100 us, groups of 200
    for (int i = 0; i < 6; ++i) f.launch_on(f.thread_b, kStreamB);
    CHECK(f.clock.num_sleeps == 0);
    REQUIRE(GatesFixture::closed.size() == 3);
    for (std::uint32_t gate = 1; gate <= 3; ++gate) {
        CHECK(f.slot().group_begin_ns[gate] == (gate - 1) * 200'000);
        CHECK(f.slot().group_time_ns[gate] == 200'000);
        CHECK(f.slot().group_utilization_ppm[gate] == 1'000'000);
    }
    CHECK(f.loose().counters.holds == 1);
}

TEST_CASE("A gate opens when what was more urgent has executed", "[runtime][gates]") {
    GatesFixture f;
    f.launch_on(f.thread_b, kStreamB);
    CHECK(f.poller.look() != exec::More::kNone);
    CHECK(f.is_closed());
    f.tight_ends();
    f.clock.advance(3ms);
    CHECK(f.poller.look() == exec::More::kNone);
    CHECK_FALSE(f.is_closed());
    SECTION("and the next launch is asked about again") {
        f.launch_on(f.thread_b, kStreamB);
        CHECK(GatesFixture::closed.size() == 1);
        CHECK(f.loose().gates.is_open);
        CHECK(f.loose().run.waited.held >= 3ms);
    }
}

TEST_CASE("A segment that ends opens the gates of others without our thread", "[runtime][gates]") {
    GatesFixture f;
    f.launch_on(f.thread_b, kStreamB);
    f.tight_ends();
    f.segments.leave(f.tight(), true);
    CHECK_FALSE(f.is_closed());
}

TEST_CASE("Where no gate may be closed, the launch waits in its thread", "[runtime][gates]") {
    GatesFixture f;
    CUstream stream = kStreamB;
    SECTION("a stream that synchronises with the legacy one") {
        GatesFixture::stream_flags = 0;
    }
    SECTION("the legacy stream") {
        stream = nullptr;
    }
    SECTION("the driver refuses") {
        GatesFixture::result = CUDA_ERROR_NOT_SUPPORTED;
    }
    SECTION("a call is under way that waits for all") {
        f.common().gate_keeper.park();
    }
    SECTION("its launching is slowed by others'") {
        f.slot().launching = abi::Launching::kSlowed;
        f.tight().slot->launching = abi::Launching::kFree;
    }
    f.launch_on(f.thread_b, stream);
    CHECK(GatesFixture::closed.empty());
    CHECK_FALSE(f.is_closed());
    CHECK(f.clock.num_sleeps > 0);
}

TEST_CASE("Before a call that waits for all work every gate opens, until it has returned",
          "[runtime][gates]") {
    GatesFixture f;
    f.launch_on(f.thread_b, kStreamB);
    REQUIRE(f.is_closed());
    f.common().gate_keeper.park();
    f.common().gate_keeper.park();
    CHECK_FALSE(f.is_closed());
    f.common().gate_keeper.unpark();
    CHECK(f.common().gate_keeper.is_parked());
    f.common().gate_keeper.unpark();
    CHECK_FALSE(f.common().gate_keeper.is_parked());
    CHECK(f.common().gate_keeper.counts().parks == 1);
}

TEST_CASE("What takes a multiprocessor's shared memory finds no resident dispatcher there",
          "[runtime][gates]") {
    const auto launched_by_task = GENERATE(true, false);
    const auto shared_bytes = GENERATE(0u, 100u << 10, 120u << 10);
    GatesFixture f(config::Dispatch::kDevice);
    f.driver.api.cuDeviceGetAttribute = [](int* value, CUdevice_attribute, CUdevice) {
        *value = 228 << 10;
        return CUDA_SUCCESS;
    };
    // Its marks' parameters are others than the driver's here knows.
    f.driver.api.cuLaunchKernelEx = [](const CUlaunchConfig*, CUfunction, void**, void**) {
        return CUDA_SUCCESS;
    };
    f.launch_on(f.thread_b, kStreamB);
    REQUIRE(f.is_closed());
    auto& dispatcher = f.common().gate_keeper.dispatcher();
    const exec::DispatchContext* context = f.loose().gates.dispatch;
    REQUIRE(context);
    REQUIRE(context->lease_page->stop == 0);
    REQUIRE(dispatcher.may_reside());
    const auto strangers = reinterpret_cast<CUstream>(0x7700);
    runtime::Launch launch{kConv, 100, 256, launched_by_task ? kStreamA : strangers};
    launch.shared_bytes = shared_bytes;
    ThreadState stranger;
    const Grant grant = f.launches.before(launched_by_task ? f.thread_a : stranger, launch);
    CHECK((grant.task != nullptr) == launched_by_task);
    CHECK(context->lease_page->stop == (shared_bytes == 120u << 10));
}

TEST_CASE("What fills every thread slot finds no resident dispatcher there, with auto",
          "[runtime][gates]") {
    const auto where = GENERATE(config::Dispatch::kAuto, config::Dispatch::kDevice);
    const auto device = GENERATE(config::DeviceDispatch::kLeased, config::DeviceDispatch::kArmed);
    const auto launched_by_task = GENERATE(true, false), fills = GENERATE(true, false);
    GatesFixture f(where, device);
    runtime::GateKeeper& keeper = f.common().gate_keeper;
    // Sleeps end late: cores are busy, or no gate would be wanted.
    for (int i = 0; i < sched::CoreLoad::kLeast; ++i) keeper.slept(50us, 10ms, f.clock.now());
    f.clock.advance(1us);
    keeper.slept(50us, 10ms, f.clock.now() + sched::CoreLoad::kWindow);
    f.driver.api.cuLaunchKernelEx = [](const CUlaunchConfig*, CUfunction, void**, void**) {
        return CUDA_SUCCESS;
    };
    f.launch_on(f.thread_b, kStreamB);
    REQUIRE(f.is_closed());
    const auto& stop = f.loose().gates.dispatch->lease_page->stop;
    REQUIRE(stop == 0);
    constexpr std::uint32_t kThreads = 16;
    const auto slots = static_cast<std::uint64_t>(f.tight().tracked.marks->resident_threads);
    REQUIRE(slots % kThreads == 0);
    const auto strangers = reinterpret_cast<CUstream>(0x7700);
    const runtime::Launch launch{kConv, slots / kThreads - !fills, kThreads,
                                 launched_by_task ? kStreamA : strangers};
    ThreadState stranger;
    ThreadState& thread = launched_by_task ? f.thread_a : stranger;
    const Grant grant = f.launches.before(thread, launch);
    CHECK((grant.task != nullptr) == launched_by_task);
    const bool leaves =
        fills && where == config::Dispatch::kAuto && device == config::DeviceDispatch::kLeased;
    CHECK(stop == leaves);
    // So the next one is asked about, too.
    CHECK(f.common().kernels.find(thread.kernels, thread.tracing.cursor, launch).needs_room ==
          leaves);
}

TEST_CASE("A task's late gate is counted", "[runtime][gates]") {
    GatesFixture f;
    f.launch_on(f.thread_b, kStreamB);
    REQUIRE(f.is_closed());
    const auto late = GENERATE(1ms, 3ms);
    f.clock.advance(nanoseconds(f.slot().gate_by_ns) - f.clock.now() + late);
    f.poller.look();
    REQUIRE_FALSE(f.is_closed());
    f.common().gate_keeper.ends(f.loose(), f.clock.now());
    const observe::GateStatistics counts = f.common().gate_keeper.counts();
    CHECK(counts.past_bound == (late == 3ms));
    CHECK(counts.most_past_us == (late == 3ms ? 3000 : 0));
}

TEST_CASE("NVTX tool gets a mark of gates that open before a call that waits for all work",
          "[runtime][gates][nvtx]") {
    GatesFixture f;
    const NvtxTool tool;
    f.common().observers.nvtx.attach(
        NvtxTool::link(),
        {f.common().governor.tasks(), f.common().progress.gpu_clock(), {"detect", "detect"}});
    const auto parks = [] { return NvtxTool::marks(observe::nvtx::Category::kDispatch, "park"); };
    f.common().gate_keeper.park();  // none is closed
    f.common().gate_keeper.unpark();
    CHECK(parks().empty());
    f.launch_on(f.thread_b, kStreamB);
    REQUIRE(f.is_closed());
    f.common().gate_keeper.park();
    f.common().gate_keeper.unpark();
    REQUIRE(parks().size() == 1);
    CHECK(parks()[0].rfind("task -, closed ", 0) == 0);
}

TEST_CASE("Switched off, our thread opens all gates", "[runtime][gates]") {
    GatesFixture f;
    f.launch_on(f.thread_b, kStreamB);
    f.common().governor.steered().set(config::Mode::kOff);
    CHECK(f.poller.look() == exec::More::kNone);
    CHECK_FALSE(f.is_closed());
}

TEST_CASE("Switched off, gates open before our thread looks again", "[runtime][gates]") {
    GatesFixture f;
    f.launch_on(f.thread_b, kStreamB);
    REQUIRE(f.is_closed());
    f.common().governor.steered().set(config::Mode::kOff);
    f.common().gate_keeper.holds_end();
    CHECK_FALSE(f.is_closed());
}

TEST_CASE("Once our thread has stopped, all gates are open, and none is closed",
          "[runtime][gates]") {
    GatesFixture f;
    f.launch_on(f.thread_b, kStreamB);
    f.poller.stopped = true;
    f.poller.stop();
    CHECK_FALSE(f.is_closed());
    f.tight().slot->waits = 0;
    f.launch_on(f.thread_b, kStreamB);
    CHECK_FALSE(f.is_closed());
    CHECK(GatesFixture::closed.size() == 1);
}

TEST_CASE("A gate of a task that does nothing any more is opened", "[runtime][gates]") {
    GatesFixture f;
    f.launch_on(f.thread_b, kStreamB);
    f.common().page().active[0] = 1;  // the other one only
    f.poller.look();
    CHECK_FALSE(f.is_closed());
}

TEST_CASE("A gate opens by itself when its instance was held for its bound", "[runtime][gates]") {
    GatesFixture f;
    f.launch_on(f.thread_b, kStreamB);
    for (abi::TaskSlot* slot : {f.tight().slot, f.loose().slot}) {  // else they would be late
        slot->deadline_ns += nanoseconds(1s).count();
        slot->relative_deadline_ns += nanoseconds(1s).count();
    }
    f.clock.advance(199ms);  // two deadlines
    f.tight().slot->launch_ns = f.tight().slot->progress_ns = f.clock.now().count();
    f.poller.look();
    CHECK(f.is_closed());
    f.clock.advance(1ms);
    f.tight().slot->launch_ns = f.tight().slot->progress_ns = f.clock.now().count();
    f.poller.look();
    CHECK_FALSE(f.is_closed());
}

TEST_CASE("So many gates of a task are closed at most; then its thread waits", "[runtime][gates]") {
    GatesFixture f;
    f.clock.on_sleep = [&] { f.tight_ends(); };
    for (int i = 0; i < 2 * f.resolved.config.scheduler.dispatch.most_gates + 1; ++i)
        f.launch_on(f.thread_b, kStreamB);
    CHECK(GatesFixture::closed.size() >=
          static_cast<std::size_t>(f.resolved.config.scheduler.dispatch.most_gates));
    CHECK(f.clock.num_sleeps > 0);
    CHECK(f.loose().run.waited.paced > 0us);
}

TEST_CASE("What a task launches elsewhere waits until its gates are open", "[runtime][gates]") {
    GatesFixture f;
    f.launch_on(f.thread_b, kStreamB);
    f.clock.on_sleep = [&] { f.tight_ends(); };
    f.launch_on(f.thread_b, reinterpret_cast<CUstream>(0xc0));
    CHECK(f.clock.num_sleeps > 0);
    CHECK_FALSE(f.is_closed());
}
