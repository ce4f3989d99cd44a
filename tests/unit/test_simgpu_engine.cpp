// SPDX-License-Identifier: Apache-2.0
//
// The simulated GPU in virtual time: how kernels share it, waves, priorities.
#include <string>
#include <vector>

#include "tests/support/catch.h"
#include "tests/support/virtual_gpu.h"

using namespace urgengo::simgpu;
using Gpu = VirtualGpu;

TEST_CASE("Engine runs a grid in waves when it is larger than the GPU", "[unit][simgpu]") {
    Gpu gpu;
    gpu.kernel(gpu.stream(), "a", 10, 100, 0, 2);  // room for 4 blocks
    gpu.advance(299);
    CHECK(gpu.runs.empty());
    gpu.advance(300);
    CHECK(gpu.runs["a"] == Gpu::Run{0, 300});
}

TEST_CASE("Engine shares SMs when kernels of several streams fit together", "[unit][simgpu]") {
    Gpu gpu;
    gpu.kernel(gpu.stream(), "a", 2, 100, 0, 2);
    gpu.kernel(gpu.stream(), "b", 2, 100, 0, 2);
    gpu.advance(kLong);
    CHECK(gpu.runs["a"] == Gpu::Run{0, 100});
    CHECK(gpu.runs["b"] == Gpu::Run{0, 100});
}

TEST_CASE("Engine runs devices side by side when there are several", "[unit][simgpu]") {
    Part part = small_part();
    part.num_in_machine = 2;
    Gpu gpu(part);
    const auto there = gpu.stream(Kind::kNonBlocking, 2, 1);
    const Fence first = gpu.kernel(gpu.stream(), "a", 2, 100);
    gpu.advance(1);
    gpu.kernel(gpu.stream(), "b", 2, 100, -5);  // the first device is full
    gpu.kernel(there, "c", 2, 100);
    gpu.submit(there, TimedWork{}, {first});
    gpu.kernel(there, "d", 2, 100, 0);
    std::string copies;
    gpu.submit(gpu.stream(), CopyWork{CopyEngine::kHostToDevice, Time{50}, [&] { copies += "0"; }});
    gpu.submit(gpu.stream(Kind::kNonBlocking, 2, 1),
               CopyWork{CopyEngine::kHostToDevice, Time{40}, [&] { copies += "1"; }});
    gpu.advance(60);
    CHECK(copies == "10");
    gpu.advance(kLong);
    CHECK(gpu.runs["a"] == Gpu::Run{0, 100});
    CHECK(gpu.runs["b"] == Gpu::Run{100, 200});
    CHECK(gpu.runs["c"] == Gpu::Run{1, 101});
    CHECK(gpu.runs["d"].start >= 100);
}

TEST_CASE("Engine gives free room to the most urgent kernel when several wait", "[unit][simgpu]") {
    Gpu gpu;
    gpu.kernel(gpu.stream(), "l", 6, 100, 0);  // three waves
    gpu.advance(10);
    gpu.kernel(gpu.stream(), "m", 2, 100, -2);
    gpu.kernel(gpu.stream(), "h", 2, 100, -5);
    gpu.advance(kLong);
    // Nothing is preempted: the first wave ends at 100.
    CHECK(gpu.runs["h"] == Gpu::Run{100, 200});
    CHECK(gpu.runs["m"] == Gpu::Run{200, 300});
    CHECK(gpu.runs["l"] == Gpu::Run{0, 500});
}

TEST_CASE("Engine serves first the kernel that was ready first when priorities are equal",
          "[unit][simgpu]") {
    Gpu gpu;
    gpu.kernel(gpu.stream(), "a", 4, 100);
    gpu.advance(10);
    gpu.kernel(gpu.stream(), "b", 4, 100);
    gpu.advance(20);
    gpu.kernel(gpu.stream(), "c", 2, 100);
    gpu.advance(kLong);
    CHECK(gpu.order == "abc");
    CHECK(gpu.runs["b"] == Gpu::Run{200, 400});
}

TEST_CASE("Engine serves the more urgent kernel when two become ready at one moment",
          "[unit][simgpu]") {
    Gpu gpu;
    gpu.kernel(gpu.stream(), "l", 2, 100, 0);
    gpu.kernel(gpu.stream(), "h", 2, 100, -1);
    gpu.advance(kLong);
    CHECK(gpu.order == "hl");
}

TEST_CASE("Engine keeps room for the first kernel when only a later one would fit",
          "[unit][simgpu]") {
    Gpu gpu;
    gpu.kernel(gpu.stream(), "a", 2, 100, 0, 2);   // half of each SM
    gpu.kernel(gpu.stream(), "b", 1, 100, -1, 1);  // a whole SM
    gpu.advance(kLong);
    CHECK(gpu.runs["b"] == Gpu::Run{0, 100});
    Gpu other;
    other.kernel(other.stream(), "a", 2, 100, -5, 2);
    other.kernel(other.stream(), "b", 1, 100, -1, 1);
    other.kernel(other.stream(), "c", 2, 100, 0, 2);
    other.advance(kLong);
    CHECK(other.runs["b"] == Gpu::Run{100, 200});
    CHECK(other.runs["c"].start == 100);
}

TEST_CASE("Engine hides the launch overhead when a launch may overlap", "[unit][simgpu]") {
    Part part = small_part();
    part.launch_overhead = Time{20};
    Gpu gpu(part);
    const auto stream = gpu.stream();
    gpu.kernel(stream, "a", 1, 100);
    KernelWork overlapping{.name = std::make_shared<const std::string>("b"),
                           .block_time = Time{10},
                           .overlaps_launch = true,
                           .run = {}};
    gpu.submit(stream, std::move(overlapping));
    gpu.advance(kLong);
    CHECK(gpu.runs["b"] == Gpu::Run{100, 110});
}

TEST_CASE("Engine gives the same times when it is advanced late or in steps", "[unit][simgpu]") {
    const auto play = [](std::int64_t step) {
        Gpu gpu;
        const auto a = gpu.stream();
        const auto b = gpu.stream();
        for (int i = 0; i < 5; ++i) {
            gpu.kernel(a, "a" + std::to_string(i), 3, 100 + i, 0);
            gpu.kernel(b, "b" + std::to_string(i), 5, 37, -i);
        }
        for (std::int64_t t = 0; t <= 10000; t += step) gpu.advance(t);
        return gpu.runs;
    };
    const auto late = play(10000);
    CHECK(late.size() == 10);
    CHECK(late == play(1));
}

TEST_CASE("Engine tells when something is due next when work is under way", "[unit][simgpu]") {
    Gpu gpu;
    CHECK_FALSE(gpu.engine.next_event());
    gpu.kernel(gpu.stream(), "a", 1, 100);
    gpu.advance(0);
    REQUIRE(gpu.engine.next_event());
    CHECK(*gpu.engine.next_event() == Time{100});
    gpu.advance(100);
    CHECK_FALSE(gpu.engine.next_event());
}

TEST_CASE("Engine runs a kernel's own code at its nominal end when it has some", "[unit][simgpu]") {
    Gpu gpu;
    Time ran_at{0};
    KernelWork work{.name = std::make_shared<const std::string>("a"),
                    .block_time = Time{42},
                    .run = [&ran_at](Time end) { ran_at = end; }};
    const Fence fence = gpu.submit(gpu.stream(), std::move(work));
    gpu.advance(41);
    CHECK(ran_at == Time{0});
    gpu.advance(kLong);
    CHECK(ran_at == Time{42});
    CHECK(fence.passed());
}
