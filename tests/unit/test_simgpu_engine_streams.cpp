// SPDX-License-Identifier: Apache-2.0
//
// The simulated GPU in virtual time: stream and legacy-stream order, fences, copies, waits.
#include <string>
#include <vector>

#include "tests/support/catch.h"
#include "tests/support/virtual_gpu.h"

using namespace urgengo::simgpu;
using Gpu = VirtualGpu;
using Kind = StreamQueue::Kind;

TEST_CASE("Engine keeps a stream's order and launch overhead when kernels queue",
          "[unit][simgpu]") {
    Part part = small_part();
    part.launch_overhead = Time{20};
    Gpu gpu(part);
    const auto stream = gpu.stream();
    gpu.kernel(stream, "a", 1, 100);
    gpu.kernel(stream, "b", 1, 100, -5);
    gpu.advance(500);
    CHECK(gpu.runs["b"] == Gpu::Run{120, 220});
    gpu.kernel(stream, "c", 1, 100);  // the stream has been idle: nothing to add
    gpu.advance(kLong);
    CHECK(gpu.runs["c"] == Gpu::Run{500, 600});
}

TEST_CASE("Engine starts work no earlier than its submission when the stream is idle",
          "[unit][simgpu]") {
    Gpu gpu;
    gpu.advance(777);
    gpu.kernel(gpu.stream(), "a", 1, 100);
    gpu.advance(kLong);
    CHECK(gpu.runs["a"] == Gpu::Run{777, 877});
}

TEST_CASE("Engine orders blocking streams around the legacy stream when it is used",
          "[unit][simgpu]") {
    Gpu gpu;
    const auto legacy = gpu.stream(Kind::kLegacy);
    const auto blocking = gpu.stream(Kind::kBlocking);
    const auto other = gpu.stream(Kind::kBlocking);
    const auto free = gpu.stream(Kind::kNonBlocking);
    const auto elsewhere = gpu.stream(Kind::kBlocking, 2);
    gpu.kernel(blocking, "a", 1, 100, 0, 8);
    gpu.kernel(legacy, "L", 1, 100, 0, 8);
    gpu.kernel(other, "b", 1, 100, 0, 8);
    gpu.kernel(free, "f", 1, 100, 0, 8);
    gpu.kernel(elsewhere, "e", 1, 100, 0, 8);
    gpu.advance(kLong);
    CHECK(gpu.runs["a"] == Gpu::Run{0, 100});
    CHECK(gpu.runs["L"] == Gpu::Run{100, 200});
    CHECK(gpu.runs["b"] == Gpu::Run{200, 300});
    CHECK(gpu.runs["f"] == Gpu::Run{0, 100});
    CHECK(gpu.runs["e"] == Gpu::Run{0, 100});
}

TEST_CASE("Engine lets a legacy command ignore what comes after it when streams are blocking",
          "[unit][simgpu]") {
    Gpu gpu;
    const auto legacy = gpu.stream(Kind::kLegacy);
    const auto blocking = gpu.stream(Kind::kBlocking);
    gpu.kernel(blocking, "a", 1, 100, 0, 8);
    gpu.kernel(legacy, "L", 1, 100, 0, 8);
    gpu.kernel(blocking, "b", 1, 1000, 0, 8);
    gpu.kernel(legacy, "M", 1, 100, 0, 8);
    gpu.advance(kLong);
    CHECK(gpu.order == "aLbM");
    CHECK(gpu.runs["L"] == Gpu::Run{100, 200});
}

TEST_CASE("Engine holds a stream when its command waits for another stream's", "[unit][simgpu]") {
    Gpu gpu;
    const auto producer = gpu.stream();
    const auto consumer = gpu.stream();
    gpu.kernel(producer, "p", 1, 100, 0, 8);
    const Fence event = gpu.submit(producer, TimedWork{});
    gpu.kernel(producer, "q", 1, 500, 0, 8);
    gpu.kernel(consumer, "x", 1, 10, 0, 8);
    gpu.submit(consumer, TimedWork{}, {event});
    gpu.kernel(consumer, "c", 1, 10, 0, 8);
    gpu.advance(99);
    CHECK_FALSE(event.passed());
    gpu.advance(kLong);
    CHECK(gpu.runs["x"] == Gpu::Run{0, 10});
    CHECK(gpu.runs["c"] == Gpu::Run{100, 110});
    CHECK(gpu.runs["q"] == Gpu::Run{101, 601});
}

TEST_CASE("Engine stamps an event with the nominal time when it is advanced late",
          "[unit][simgpu]") {
    Gpu gpu;
    const auto stream = gpu.stream();
    Time stamp{0};
    gpu.kernel(stream, "a", 1, 123);
    gpu.submit(stream, TimedWork{Time{0}, [&stamp](Time end) { stamp = end; }});
    gpu.advance(kLong);
    CHECK(stamp == Time{123});
}

TEST_CASE("Engine serves copies in order when they share a copy engine", "[unit][simgpu]") {
    Gpu gpu;
    std::string done;
    std::vector<Fence> fences;
    const auto copy = [&](CopyEngine engine, std::int64_t ns, char name) {
        return gpu.submit(gpu.stream(),
                          CopyWork{engine, Time{ns}, [&done, name] { done += name; }});
    };
    const Fence first = copy(CopyEngine::kHostToDevice, 100, 'a');
    const Fence second = copy(CopyEngine::kHostToDevice, 10, 'b');
    const Fence other = copy(CopyEngine::kDeviceToHost, 50, 'c');
    gpu.advance(50);
    CHECK(other.passed());
    CHECK_FALSE(first.passed());
    gpu.advance(109);
    CHECK(first.passed());
    CHECK_FALSE(second.passed());
    gpu.advance(110);
    CHECK(done == "cab");
}

TEST_CASE("Engine holds a stream at a value wait when the value is not there", "[unit][simgpu]") {
    Gpu gpu;
    const auto stream = gpu.stream();
    bool open = false;
    gpu.submit(stream, ValueWait{1, [&open] { return open; }});
    gpu.kernel(stream, "a", 1, 100);
    gpu.advance(500);
    CHECK(gpu.engine.has_value_waits());
    CHECK_FALSE(gpu.engine.next_event());
    open = true;
    gpu.engine.look_at_memory();
    gpu.advance(1000);
    gpu.engine.open_seen_waits();
    gpu.advance(2000);
    CHECK_FALSE(gpu.engine.has_value_waits());
    CHECK(gpu.runs["a"] == Gpu::Run{1000, 1100});
}

TEST_CASE("Engine goes on without looking when a value was there at the wait's submission",
          "[unit][simgpu]") {
    Gpu gpu;
    const auto stream = gpu.stream();
    bool open = true;
    gpu.kernel(stream, "a", 1, 100);
    gpu.submit(stream, ValueWait{1, [&open] { return open; }, true});
    gpu.kernel(stream, "b", 1, 100);
    gpu.submit(stream, ValueWait{1, [&open] { return open; }, true});
    gpu.kernel(stream, "c", 1, 100);
    gpu.advance(150);
    open = false;  // changed back before the second wait comes to it
    gpu.advance(kLong);
    CHECK(gpu.runs["b"] == Gpu::Run{101, 201});
    CHECK(gpu.order == "ab");
}

TEST_CASE("Engine opens a value wait at once when another stream's work writes the value",
          "[unit][simgpu]") {
    Gpu gpu;
    const auto writer = gpu.stream();
    const auto waiter = gpu.stream();
    bool open = false;
    gpu.submit(waiter, ValueWait{0x1004, [&open] { return open; }});
    gpu.kernel(waiter, "w", 1, 10, 0, 8);
    gpu.kernel(writer, "a", 1, 100, 0, 8);
    gpu.submit(writer, TimedWork{Time{5}, [&open](Time) { open = true; }, {0x1000, 8}});
    gpu.advance(kLong);
    CHECK(gpu.runs["w"] == Gpu::Run{105, 115});
}

TEST_CASE("Engine holds a stream when its host function has not returned", "[unit][simgpu]") {
    Gpu gpu;
    const auto stream = gpu.stream();
    bool ran = false;
    const Fence call = gpu.submit(stream, HostCall{[&ran] { ran = true; }});
    gpu.kernel(stream, "a", 1, 100);
    gpu.advance(500);
    REQUIRE(gpu.host_calls.size() == 1);
    gpu.host_calls[0].second();
    CHECK(ran);
    CHECK_FALSE(call.passed());
    gpu.engine.finish_host_call(*stream);
    CHECK(call.passed());
    gpu.advance(kLong);
    CHECK(gpu.runs["a"] == Gpu::Run{500, 600});
}
