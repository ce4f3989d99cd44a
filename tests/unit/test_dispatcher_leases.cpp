// SPDX-License-Identifier: Apache-2.0
//
// When a resident dispatcher is launched on the GPU, and when it is not.
#include <functional>
#include <memory>
#include <vector>

#include "host/exec/dispatcher.h"
#include "host/exec/progress_marks.h"
#include "tests/support/catch.h"
#include "tests/support/dispatch_driver.h"

using namespace urgengo;
using std::chrono::nanoseconds;
using testing::kSharedBytes;
using testing::let_dispatcher_be_set_up;

namespace {

constexpr nanoseconds kLease{2'000'000}, kNow{1'000'000'000}, kMs{1'000'000};
const auto kHandle = reinterpret_cast<CUcontext>(0x1000);
constexpr unsigned long long kId = 7;

/// A driver that launches leases, and a context that may end.
struct Leases {
    inline static int launched = 0;
    inline static std::uint64_t idle_ns = 0;       ///< of the last one
    inline static CUresult result = CUDA_SUCCESS;  ///< of launches
    inline static bool context_is_there = true, can_be_current = true;
    inline static std::function<void()> in_driver;  ///< by the thread that is in one of its calls
    exec::DriverApi api;
    std::unique_ptr<abi::SharedPage> page = std::make_unique<abi::SharedPage>();
    exec::MarkContext marks;
    exec::Dispatcher dispatcher{
        api, *page, {.device = config::DeviceDispatch::kLeased, .idle = nanoseconds(70'000)}, 2};
    const exec::DispatchContext* context = nullptr;

    Leases() {
        launched = 0;
        result = CUDA_SUCCESS;
        context_is_there = can_be_current = true;
        in_driver = {};
        api.cuStreamWaitValue32_v2 = [](CUstream, CUdeviceptr, cuuint32_t, unsigned) {
            return CUDA_SUCCESS;
        };
        let_dispatcher_be_set_up(api);
        api.cuStreamCreateWithPriority = [](CUstream* stream, unsigned, int) {
            *stream = reinterpret_cast<CUstream>(0x3000);
            return CUDA_SUCCESS;
        };
        api.cuModuleGetFunction = [](CUfunction*, CUmodule, const char*) { return CUDA_SUCCESS; };
        api.cuLaunchKernelEx = [](const CUlaunchConfig*, CUfunction, void** parameters, void**) {
            if (in_driver) in_driver();
            if (result != CUDA_SUCCESS) return result;
            ++launched;
            idle_ns = *static_cast<std::uint64_t*>(parameters[3]);
            return CUDA_SUCCESS;
        };
        api.cuCtxSetCurrent = [](CUcontext) {
            if (in_driver) in_driver();
            return can_be_current ? CUDA_SUCCESS : CUDA_ERROR_INVALID_CONTEXT;
        };
        api.cuCtxGetId = [](CUcontext, unsigned long long* id) {
            *id = kId;
            return context_is_there ? CUDA_SUCCESS : CUDA_ERROR_CONTEXT_IS_DESTROYED;
        };
        marks.id = kId;
        marks.handle = kHandle;
        context = dispatcher.prepare(marks);
        REQUIRE(context);
        REQUIRE(launched == 1);  // so that it is loaded: it ends at once
        launched = 0;
    }
    int extended(nanoseconds now = kNow) {
        const int before = launched;
        dispatcher.extend_lease(kLease, now);
        return launched - before;
    }
    bool extended_from_outside() { return dispatcher.extend_lease_from_outside(kLease, kNow); }
    void one_ends() { ++context->lease_page->ended; }
};

}  // namespace

TEST_CASE("Three leases are under way at most", "[exec][dispatcher]") {
    Leases leases;
    CHECK(leases.extended() == 3);
    CHECK(leases.extended() == 0);
    CHECK_FALSE(leases.dispatcher.has_ended());
    leases.one_ends();
    CHECK(leases.extended() == 1);
    for (int i = 0; i < 3; ++i) leases.one_ends();
    CHECK(leases.dispatcher.has_ended());
}

TEST_CASE("A lease is told for how long it may find no gate closed, and which one is the last",
          "[exec][dispatcher]") {
    Leases leases;
    const abi::DispatchLease& page = *leases.context->lease_page;
    leases.extended();
    CHECK(Leases::idle_ns == 70'000);
    CHECK(page.launched == 3);
    leases.one_ends();
    Leases::result = CUDA_ERROR_UNKNOWN;
    leases.extended();
    CHECK(page.launched == 3);  // there is no other
}

TEST_CASE("No lease begins between a park's end and going on", "[exec][dispatcher]") {
    Leases leases;
    leases.dispatcher.end_lease();
    CHECK(leases.context->lease_page->stop == 1);
    CHECK(leases.extended() == 0);
    leases.dispatcher.go_on();
    CHECK(leases.extended() == 3);
}

TEST_CASE("No lease begins after a cooperative launch, whatever parks later",
          "[exec][dispatcher]") {
    Leases leases;
    leases.dispatcher.never_again();
    leases.dispatcher.end_lease();
    leases.dispatcher.go_on();
    CHECK(leases.context->lease_page->stop == 1);  // what was launched before ends, too
    CHECK(leases.extended() == 0);
}

TEST_CASE("Leases stay away for as long as a kernel needs their room", "[exec][dispatcher]") {
    Leases leases;
    CHECK_FALSE(leases.dispatcher.has_no_room_for(kSharedBytes / 2));
    CHECK(leases.dispatcher.has_no_room_for(kSharedBytes / 2 + 1));
    leases.dispatcher.leave_until(kNow + 3 * kMs);
    CHECK(leases.context->lease_page->stop == 1);
    CHECK(leases.extended() == 0);
    leases.dispatcher.leave_until(kNow + 2 * kMs);  // ends earlier
    leases.dispatcher.end_lease();
    leases.dispatcher.go_on();  // a call has parked meanwhile
    CHECK(leases.context->lease_page->stop == 1);
    CHECK(leases.extended(kNow + 3 * kMs - nanoseconds(1)) == 0);
    SECTION("and come back then") {
        CHECK(leases.extended(kNow + 3 * kMs) == 3);
        CHECK(leases.context->lease_page->stop == 0);
    }
    SECTION("but not while a call has parked") {
        leases.page->dispatch.parked = 1;
        CHECK(leases.extended(kNow + 3 * kMs) == 0);
        leases.page->dispatch.parked = 0;
        leases.dispatcher.go_on();
        CHECK(leases.extended(kNow + 3 * kMs) == 3);
    }
}

TEST_CASE("No lease begins where the GPU is another process' now and then", "[exec][dispatcher]") {
    Leases leases;
    leases.context->lease_page->gaps = 2;
    CHECK(leases.extended() == 3);
    leases.one_ends();
    leases.context->lease_page->gaps = 3;
    CHECK(leases.extended() == 0);
    CHECK_FALSE(leases.dispatcher.may_reside());
}

TEST_CASE("No lease begins in a context that ends, or has ended", "[exec][dispatcher]") {
    Leases leases;
    const exec::EndingContext ending{kHandle, -1};
    leases.dispatcher.context_ends(ending);
    leases.dispatcher.go_on();  // the call that ends it has parked, too
    CHECK(leases.extended() == 0);
    CHECK_FALSE(leases.extended_from_outside());
    SECTION("it has") {
        Leases::context_is_there = false;
        leases.dispatcher.context_ended(ending);
        leases.dispatcher.go_on();
        CHECK(leases.extended() == 0);
        CHECK_FALSE(leases.extended_from_outside());
    }
    SECTION("it is used on") {
        leases.dispatcher.context_ended(ending);
        CHECK(leases.extended_from_outside());
        CHECK(Leases::launched == 3);
    }
}

TEST_CASE("Leases go on when a context that might have ended lives on, but not while parked",
          "[exec][dispatcher]") {
    Leases leases;
    const exec::EndingContext ending{kHandle, -1};
    // As the interposer's call does it, the last one after the call's park.
    leases.dispatcher.context_ends(ending);
    leases.dispatcher.go_on();
    leases.dispatcher.context_ends(ending);
    SECTION("nothing is parked") {
        leases.dispatcher.context_ended(ending);
        CHECK(leases.context->lease_page->stop == 0);
        CHECK(leases.extended() == 3);
    }
    SECTION("another thread's call is under way") {
        leases.page->dispatch.parked = 1;
        leases.dispatcher.context_ended(ending);
        CHECK(leases.context->lease_page->stop == 1);
        leases.page->dispatch.parked = 0;
        leases.dispatcher.go_on();
        CHECK(leases.extended() == 3);
    }
}

TEST_CASE("One thread at a time is in a context for leases, also while it makes that its own",
          "[exec][dispatcher]") {
    Leases leases;
    int others = 0;
    Leases::in_driver = [&] {
        Leases::in_driver = {};
        others = leases.extended();  // by another thread
    };
    CHECK(leases.extended_from_outside());
    CHECK(others == 0);
    CHECK(Leases::launched == 3);
}

TEST_CASE("Leases go on after a thread was cancelled while it launched one", "[exec][dispatcher]") {
    Leases leases;
    const auto entry = GENERATE(true, false);
    Leases::in_driver = [] { throw 0; };  // unwinds as a cancelled thread does
    CHECK_THROWS_AS(entry ? leases.extended_from_outside() : leases.extended() > 0, int);
    Leases::in_driver = {};
    CHECK(leases.extended() > 0);
}

TEST_CASE("Another context's end changes nothing for leases", "[exec][dispatcher]") {
    Leases leases;
    leases.dispatcher.context_ends({reinterpret_cast<CUcontext>(0x9000), -1});
    CHECK(leases.extended() == 3);
}

TEST_CASE("A context that ends while gates are set up there is none that refuses them",
          "[exec][dispatcher]") {
    Leases leases;
    const exec::EndingContext ending{kHandle, -1};
    exec::Dispatcher dispatcher{
        leases.api, *leases.page, {.device = config::DeviceDispatch::kLeased}, 2};
    static std::function<void()> when_asked;
    leases.api.cuMemAlloc_v2 = [](CUdeviceptr*, std::size_t) {
        if (when_asked) when_asked();
        return CUDA_ERROR_CONTEXT_IS_DESTROYED;
    };
    const auto is_asked_again = [&] {
        let_dispatcher_be_set_up(leases.api);
        return dispatcher.prepare(leases.marks) != nullptr;
    };
    when_asked = {};
    SECTION("it began to end before") {
        dispatcher.context_ends(ending);
        CHECK_FALSE(dispatcher.prepare(leases.marks));
        dispatcher.context_ended(ending);
        CHECK(is_asked_again());
    }
    SECTION("it begins to end meanwhile") {
        when_asked = [&] { dispatcher.context_ends(ending); };
        CHECK_FALSE(dispatcher.prepare(leases.marks));
        CHECK(is_asked_again());
    }
    SECTION("it had ended before") {
        Leases::context_is_there = false;
        CHECK_FALSE(dispatcher.prepare(leases.marks));
        CHECK(is_asked_again());
    }
    SECTION("the driver refuses in one that stays") {
        dispatcher.context_ends(ending);
        dispatcher.context_ended(ending);
        CHECK_FALSE(dispatcher.prepare(leases.marks));
        CHECK_FALSE(is_asked_again());
    }
}
