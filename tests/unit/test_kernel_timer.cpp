// SPDX-License-Identifier: Apache-2.0
//
// Kernels timed by marks: launching is never a kernel's time.
#include "host/exec/kernel_timer.h"

#include <functional>

#include "tests/support/catch.h"
#include "tests/support/fake_driver.h"

using namespace urgengo;
using namespace urgengo::exec;
using namespace urgengo::testing;

namespace {

std::function<void()> on_delay;  // a plain function carries no state
std::uint64_t last_delay_ns = 0;
int num_delays = 0;

CUresult CUDAAPI launch_delay(CUfunction, unsigned, unsigned, unsigned, unsigned, unsigned,
                              unsigned, unsigned, CUstream, void** parameters, void**) {
    last_delay_ns = *static_cast<std::uint64_t*>(parameters[0]);
    ++num_delays;
    if (on_delay) on_delay();
    return CUDA_SUCCESS;
}

struct Timed {
    Timed() {
        driver.api.cuLaunchKernel = driver.api.cuLaunchKernel_ptsz = launch_delay;
        num_delays = 0;
        context = marks.prepare();
        REQUIRE(context);
        timer = KernelTimer::create(marks, *context);
        REQUIRE(timer);
    }

    /// @param at_once  the GPU executes the mark before the kernel comes
    void launch(abi::TraceRecord& record, bool at_once = false) {
        timer->before_launch(stream, StreamFlavor::kLegacy);
        if (at_once) driver.execute_marks(driver.marks.size());
        timer->after_launch(&record, stream, StreamFlavor::kLegacy);
    }

    FakeDriver driver;
    ProgressMarks marks{driver.api};
    const MarkContext* context = nullptr;
    std::unique_ptr<KernelTimer> timer;
    CUstream stream = reinterpret_cast<CUstream>(0x99);
};

}  // namespace

TEST_CASE("KernelTimer has the mark before a kernel wait on an idle stream", "[exec][timer]") {
    Timed timed;
    abi::TraceRecord first{}, second{}, third{};
    timed.launch(first);
    CHECK(num_delays == 1);
    CHECK_FALSE(first.flags & abi::kTraceLoose);
    timed.launch(second);  // the stream is busy: it begins where the first ends
    CHECK(num_delays == 1);
    CHECK_FALSE(second.flags & abi::kTraceLoose);
    timed.driver.execute_marks(3);
    timed.launch(third);
    CHECK(num_delays == 2);
    timed.driver.execute_marks(2);
    timed.timer->collect();
    CHECK(first.launch.gpu_begin_ns != 0);
    CHECK(second.launch.gpu_begin_ns == 0);
    CHECK(third.launch.gpu_end_ns != 0);
}

TEST_CASE("KernelTimer says which begin may hold some of launching, and delays longer",
          "[exec][timer]") {
    Timed timed;
    abi::TraceRecord early{}, next{};
    timed.launch(early, true);
    CHECK(early.flags & abi::kTraceLoose);
    const std::uint64_t before_ns = last_delay_ns;
    timed.driver.execute_marks(timed.driver.marks.size());
    timed.launch(next);
    CHECK_FALSE(next.flags & abi::kTraceLoose);
    CHECK(last_delay_ns == 2 * before_ns);
}

TEST_CASE("KernelTimer does not vouch for a begin that was the end before, if that has passed",
          "[exec][timer]") {
    Timed timed;
    abi::TraceRecord first{}, second{};
    timed.launch(first);
    timed.timer->before_launch(timed.stream, StreamFlavor::kLegacy);  // still busy here
    timed.driver.execute_marks(2);                                    // and now idle
    timed.timer->after_launch(&second, timed.stream, StreamFlavor::kLegacy);
    CHECK(second.flags & abi::kTraceLoose);
}
