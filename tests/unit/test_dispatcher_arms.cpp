// SPDX-License-Identifier: Apache-2.0
//
// When arms are put into an armed dispatcher's stream, when the host ticks them through, and when
// there is none.
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "host/exec/dispatcher.h"
#include "host/exec/progress_marks.h"
#include "tests/support/catch.h"
#include "tests/support/dispatch_driver.h"

using namespace urgengo;
using exec::Arms;
using testing::let_dispatcher_be_set_up;
using namespace std::chrono_literals;

namespace {

constexpr nanoseconds kLease = 2ms, kNow = 1s;
const auto kHandle = reinterpret_cast<CUcontext>(0x1000);
const auto kStream = reinterpret_cast<CUstream>(0x3000);
constexpr unsigned long long kId = 7;

/// What was put into our stream.
struct Wait {
    const std::uint32_t* tick;
    std::uint32_t number;
    bool is_open() const {
        return static_cast<std::int32_t>(__atomic_load_n(tick, __ATOMIC_ACQUIRE) - number) >= 0;
    }
};

/// A driver whose GPU runs our stream when the test says so.
struct Armed {
    inline static std::vector<Wait> waits;
    inline static std::vector<std::uint32_t> kernels;
    inline static std::vector<bool> calls;  ///< true: a wait; false: a kernel
    inline static bool context_is_there = true;
    inline static CUresult wait_result = CUDA_SUCCESS, launch_result = CUDA_SUCCESS;
    inline static std::function<void()> in_launch;
    exec::DriverApi api;
    std::unique_ptr<abi::SharedPage> page = std::make_unique<abi::SharedPage>();
    exec::MarkContext marks;
    exec::Dispatcher dispatcher{api, *page, {.device = config::DeviceDispatch::kArmed}, 2};
    const exec::DispatchContext* context = nullptr;
    nanoseconds now = 1s;

    Armed() {
        waits.clear();
        kernels.clear();
        calls.clear();
        context_is_there = true;
        wait_result = launch_result = CUDA_SUCCESS;
        in_launch = {};
        api.cuStreamWaitValue32_v2 = [](CUstream stream, CUdeviceptr word, cuuint32_t number,
                                        unsigned flags) {
            CHECK(stream == kStream);
            CHECK(flags == CU_STREAM_WAIT_VALUE_GEQ);
            if (wait_result != CUDA_SUCCESS) return wait_result;
            calls.push_back(true);
            waits.push_back({reinterpret_cast<const std::uint32_t*>(word), number});
            return CUDA_SUCCESS;
        };
        let_dispatcher_be_set_up(api);
        api.cuStreamCreateWithPriority = [](CUstream* stream, unsigned flags, int) {
            CHECK(flags == CU_STREAM_NON_BLOCKING);
            *stream = kStream;
            return CUDA_SUCCESS;
        };
        api.cuModuleGetFunction = [](CUfunction*, CUmodule, const char* name) {
            CHECK(std::string(name) != abi::kDispatchLeaseKernel);
            return CUDA_SUCCESS;
        };
        api.cuLaunchKernelEx = [](const CUlaunchConfig*, CUfunction, void** parameters, void**) {
            if (const auto call = std::exchange(in_launch, nullptr)) call();
            if (launch_result != CUDA_SUCCESS) return launch_result;
            calls.push_back(false);
            kernels.push_back(*static_cast<std::uint32_t*>(parameters[1]));
            return CUDA_SUCCESS;
        };
        api.cuCtxSetCurrent = [](CUcontext) { return CUDA_SUCCESS; };
        api.cuCtxGetId = [](CUcontext, unsigned long long* id) {
            *id = kId;
            return context_is_there ? CUDA_SUCCESS : CUDA_ERROR_CONTEXT_IS_DESTROYED;
        };
        marks.id = kId;
        marks.handle = kHandle;
        context = dispatcher.prepare(marks);
        REQUIRE(context);
        // Loaded before any gate is closed, by a kernel that waits for nothing.
        REQUIRE(kernels == std::vector<std::uint32_t>{0});
        REQUIRE(waits.empty());
        kernels.clear();
        calls.clear();
    }
    std::size_t put_by_program() {
        const std::size_t before = waits.size();
        dispatcher.extend_lease(kLease, kNow);
        return waits.size() - before;
    }
    std::size_t put_from_outside() {
        const std::size_t before = waits.size();
        CHECK(dispatcher.extend_lease_from_outside(kLease, kNow));
        return waits.size() - before;
    }
    std::size_t num_closed() const {
        std::size_t closed = 0;
        for (const Wait& wait : waits) closed += !wait.is_open();
        return closed;
    }
    /// As a mark does, and the kernel behind that wait.
    void wake() {
        const std::uint32_t next = context->lease_page->ended + 1;
        __atomic_store_n(&context->lease_page->ticks[next % abi::kArmRing], next, __ATOMIC_RELEASE);
        run_what_is_open();
    }
    void run_what_is_open() {
        for (const Wait& wait : waits) {
            if (wait.number != context->lease_page->ended + 1) continue;
            if (!wait.is_open()) return;
            context->lease_page->ended = wait.number;
        }
    }
    bool look() { return dispatcher.look_at_arms(now, kLease); }
};

}  // namespace

TEST_CASE("Arms wait in order, each for a tick of its own, and are put there anew as they end",
          "[exec][dispatcher][arms]") {
    Armed armed;
    CHECK(armed.put_by_program() == 3);
    CHECK(armed.put_by_program() == 0);
    CHECK(armed.put_from_outside() == 1);
    CHECK(armed.kernels == std::vector<std::uint32_t>{1, 2, 3, 4});
    CHECK(armed.calls == std::vector<bool>{true, false, true, false, true, false, true, false});
    CHECK(armed.num_closed() == 4);
    CHECK_FALSE(armed.dispatcher.has_ended());
    armed.wake();
    CHECK(armed.num_closed() == 3);
    CHECK(armed.put_from_outside() == 1);
    CHECK(armed.kernels.back() == 5);
}

TEST_CASE("More arms wait where marks wake them faster, and few after they were ticked through",
          "[exec][dispatcher][arms]") {
    Armed armed;
    for (int i = 0; i < 5; ++i) {
        armed.put_from_outside();
        while (armed.num_closed() > 0) armed.wake();
    }
    armed.put_from_outside();
    CHECK(armed.num_closed() == Arms::kMost);
    armed.dispatcher.end_lease();
    armed.dispatcher.go_on();
    armed.put_from_outside();
    CHECK(armed.num_closed() == Arms::kFewest);
    armed.run_what_is_open();  // what the host has ticked does not count as woken
    armed.put_from_outside();
    CHECK(armed.num_closed() == Arms::kFewest);
}

TEST_CASE("So many arms are under way at most, also of those that were ticked",
          "[exec][dispatcher][arms]") {
    Armed armed;
    for (int i = 0; i < 100; ++i) {  // the GPU has no room for any
        armed.dispatcher.end_lease();
        armed.dispatcher.go_on();
        armed.put_from_outside();
    }
    CHECK(armed.waits.size() == Arms::kMostUnderWay);
}

TEST_CASE("A park ticks all arms through, and none is put there before it is over",
          "[exec][dispatcher][arms]") {
    Armed armed;
    armed.put_from_outside();
    armed.page->dispatch.parked = 1;
    armed.dispatcher.end_lease();
    CHECK(armed.context->lease_page->stop == 1);
    CHECK(armed.num_closed() == 0);
    CHECK(armed.put_by_program() == 0);
    CHECK(armed.put_from_outside() == 0);
    CHECK_FALSE(armed.dispatcher.has_ended());
    armed.run_what_is_open();
    CHECK(armed.dispatcher.has_ended());
    armed.dispatcher.go_on();  // another call is under way
    CHECK(armed.put_by_program() == 0);
    armed.page->dispatch.parked = 0;
    armed.dispatcher.go_on();
    CHECK(armed.put_by_program() == 3);
    CHECK(armed.num_closed() == 3);
}

TEST_CASE("An arm that is put there while another thread parks goes through",
          "[exec][dispatcher][arms]") {
    Armed armed;
    // By a thread that does not wait for this one for ever.
    Armed::in_launch = [&] { armed.dispatcher.end_lease(); };
    CHECK(armed.put_by_program() == 1);
    CHECK(armed.num_closed() == 0);
}

TEST_CASE("Arms number on when all bits are used", "[exec][dispatcher][arms]") {
    Arms arms;
    auto page = std::make_unique<abi::DispatchLease>();
    const std::uint32_t last = 5;
    page->ended = last - 10;  // before 0
    arms.tick_through(*page, last - 10);
    CHECK(arms.wanted(*page, last) == Arms::kFewest);
    CHECK_FALSE(arms.is_due(*page, last, Arms::kFewest));
    CHECK(arms.is_due(*page, last, 11));
    arms.tick_through(*page, last);
    for (std::uint32_t i = 0; i < 10; ++i)
        CHECK(page->ticks[(last - i) % abi::kArmRing] == last - i);
    CHECK(arms.is_due(*page, last, Arms::kFewest));
}

TEST_CASE("An arm that waits in vain for as long as a lease is ticked through",
          "[exec][dispatcher][arms]") {
    Armed armed;
    CHECK_FALSE(armed.look());
    armed.put_from_outside();
    CHECK(armed.look());
    armed.now += kLease - 1ns;
    CHECK(armed.look());
    CHECK(armed.num_closed() == 4);
    SECTION("none is woken") {
        armed.now += 1ns;
        CHECK(armed.look());  // until it has ended
        CHECK(armed.num_closed() == 0);
        armed.run_what_is_open();
        CHECK_FALSE(armed.look());
        CHECK(armed.put_from_outside() == 4);  // a gate is closed again
    }
    SECTION("one is woken") {
        armed.wake();
        armed.now += 1ns;
        CHECK(armed.look());
        CHECK(armed.num_closed() == 3);
        armed.now += kLease;
        CHECK(armed.look());
        CHECK(armed.num_closed() == 0);
    }
    SECTION("nothing ever ends any more") {
        armed.now += kLease + 1s;
        CHECK_FALSE(armed.look());
    }
}

TEST_CASE("Arms go on after a cooperative launch, and not once UrgenGo has switched itself off",
          "[exec][dispatcher][arms]") {
    Armed armed;
    armed.dispatcher.whole_gpu_is_needed();
    CHECK(armed.put_by_program() == 3);
    armed.dispatcher.never_again();
    armed.dispatcher.go_on();
    CHECK(armed.num_closed() == 0);
    CHECK(armed.put_by_program() == 0);
}

TEST_CASE("No arm waits in a context that ends, or has ended", "[exec][dispatcher][arms]") {
    Armed armed;
    armed.put_from_outside();
    const exec::EndingContext ending{kHandle, -1};
    armed.dispatcher.context_ends(ending);
    armed.dispatcher.go_on();  // the call that ends it has parked, too
    CHECK(armed.num_closed() == 0);
    CHECK(armed.put_by_program() == 0);
    CHECK_FALSE(armed.dispatcher.extend_lease_from_outside(kLease, kNow));
    SECTION("it has") {
        Armed::context_is_there = false;
        armed.dispatcher.context_ended(ending);
        armed.dispatcher.go_on();
        CHECK(armed.put_by_program() == 0);
    }
    SECTION("it is used on") {
        armed.dispatcher.context_ended(ending);
        CHECK(armed.put_by_program() == 3);
    }
}

TEST_CASE("What the driver refuses of an arm leaves no wait in our stream",
          "[exec][dispatcher][arms]") {
    Armed armed;
    SECTION("the wait") {
        Armed::wait_result = CUDA_ERROR_NOT_SUPPORTED;
        CHECK(armed.put_by_program() == 0);
    }
    SECTION("the kernel") {
        Armed::launch_result = CUDA_ERROR_OUT_OF_MEMORY;
        CHECK(armed.put_by_program() == 1);
    }
    SECTION("its thread is cancelled") {
        Armed::in_launch = [] { throw 0; };  // unwinds as a cancelled thread does
        CHECK_THROWS_AS(armed.put_by_program(), int);
    }
    CHECK(armed.num_closed() == 0);
    CHECK(armed.dispatcher.has_ended());
    Armed::wait_result = Armed::launch_result = CUDA_SUCCESS;
    armed.kernels.clear();
    CHECK(armed.put_by_program() == 3);
    CHECK(armed.kernels == std::vector<std::uint32_t>{1, 2, 3});
}

TEST_CASE("Marks of an armed dispatcher are told where arms are", "[exec][dispatcher][arms]") {
    const auto device = GENERATE(config::DeviceDispatch::kArmed, config::DeviceDispatch::kLeased,
                                 config::DeviceDispatch::kPiggyback);
    Armed armed;
    struct Seen {
        abi::DispatchLease* arms;
        abi::MarkRanks ranks;
    };
    static Seen seen;
    armed.api.cuLaunchKernelEx = [](const CUlaunchConfig*, CUfunction, void** parameters, void**) {
        seen = {*static_cast<abi::DispatchLease**>(parameters[5]),
                *static_cast<abi::MarkRanks*>(parameters[9])};
        return CUDA_SUCCESS;
    };
    const exec::Dispatcher dispatcher{armed.api, *armed.page, {.device = device}, 2};
    exec::Mark mark;
    mark.is_before_gate = true;
    REQUIRE(dispatcher.launch_mark(*armed.context, 0, mark, 0, false) == CUDA_SUCCESS);
    CHECK((seen.arms != nullptr) == (device == config::DeviceDispatch::kArmed));
    CHECK(seen.ranks == (device == config::DeviceDispatch::kLeased ? abi::MarkRanks::kNever
                                                                   : abi::MarkRanks::kForItself));
}
