// SPDX-License-Identifier: Apache-2.0
//
// When a resident dispatcher is launched on the GPU, and when it is not.
#include <memory>
#include <vector>

#include "host/exec/dispatcher.h"
#include "host/exec/progress_marks.h"
#include "tests/support/catch.h"

using namespace urgengo;
using std::chrono::nanoseconds;

namespace {

constexpr nanoseconds kLease{2'000'000};
const auto kHandle = reinterpret_cast<CUcontext>(0x1000);
constexpr unsigned long long kId = 7;

/// A driver that launches leases, and a context that may end.
struct Leases {
    inline static int launched = 0;
    inline static bool context_is_there = true, can_be_current = true;
    exec::DriverApi api;
    std::unique_ptr<abi::SharedPage> page = std::make_unique<abi::SharedPage>();
    exec::MarkContext marks;
    exec::Dispatcher dispatcher{api, *page, config::DeviceDispatch::kLeased, 2};
    const exec::DispatchContext* context = nullptr;

    Leases() {
        launched = 0;
        context_is_there = can_be_current = true;
        api.cuStreamWaitValue32_v2 = [](CUstream, CUdeviceptr, cuuint32_t, unsigned) {
            return CUDA_SUCCESS;
        };
        api.cuMemAlloc_v2 = [](CUdeviceptr* address, std::size_t) {
            *address = 0x2000;
            return CUDA_SUCCESS;
        };
        api.cuMemsetD8Async = [](CUdeviceptr, unsigned char, std::size_t, CUstream) {
            return CUDA_SUCCESS;
        };
        api.cuMemHostRegister_v2 = [](void*, std::size_t, unsigned) { return CUDA_SUCCESS; };
        api.cuMemHostGetDevicePointer_v2 = [](CUdeviceptr* address, void* host, unsigned) {
            *address = reinterpret_cast<CUdeviceptr>(host);
            return CUDA_SUCCESS;
        };
        api.cuStreamCreateWithPriority = [](CUstream* stream, unsigned, int) {
            *stream = reinterpret_cast<CUstream>(0x3000);
            return CUDA_SUCCESS;
        };
        api.cuStreamSynchronize = [](CUstream) { return CUDA_SUCCESS; };
        api.cuModuleLoadData = [](CUmodule*, const void*) { return CUDA_SUCCESS; };
        api.cuModuleGetFunction = [](CUfunction*, CUmodule, const char*) { return CUDA_SUCCESS; };
        api.cuLaunchKernelEx = [](const CUlaunchConfig*, CUfunction, void**, void**) {
            ++launched;
            return CUDA_SUCCESS;
        };
        api.cuCtxSetCurrent = [](CUcontext) {
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
    }
    int extended() {
        const int before = launched;
        dispatcher.extend_lease(kLease);
        return launched - before;
    }
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

TEST_CASE("No lease begins in a context that ends, or has ended", "[exec][dispatcher]") {
    Leases leases;
    const exec::EndingContext ending{kHandle, -1};
    leases.dispatcher.context_ends(ending);
    leases.dispatcher.go_on();  // the call that ends it has parked, too
    CHECK(leases.extended() == 0);
    CHECK_FALSE(leases.dispatcher.make_current());
    SECTION("it has") {
        Leases::context_is_there = false;
        leases.dispatcher.context_ended(ending);
        leases.dispatcher.go_on();
        CHECK(leases.extended() == 0);
        CHECK_FALSE(leases.dispatcher.make_current());
    }
    SECTION("it is used on") {
        leases.dispatcher.context_ended(ending);
        CHECK(leases.dispatcher.make_current());
        CHECK(leases.extended() == 3);
    }
}

TEST_CASE("Another context's end changes nothing for leases", "[exec][dispatcher]") {
    Leases leases;
    leases.dispatcher.context_ends({reinterpret_cast<CUcontext>(0x9000), -1});
    CHECK(leases.extended() == 3);
}
