// SPDX-License-Identifier: Apache-2.0
//
// The simulated GPU in virtual time: waves, priorities, stream and legacy-stream order, fences,
// copies.
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "tests/support/catch.h"
#include "tools/simgpu/engine/engine.h"

using namespace urgengo::simgpu;

namespace {

using Kind = StreamQueue::Kind;

Part small_part() {
    Part part;
    part.num_sms = 2;
    part.launch_overhead = Time{1};  // the least there is
    return part;
}

/// An engine, and what happened on it by name.
class Gpu {
  public:
    struct Run {
        std::int64_t start;
        std::int64_t end;
        bool operator==(const Run&) const = default;
    };

    explicit Gpu(Part part = small_part())
        : engine(part, {.host_call =
                            [this](Engine::QueuePtr queue, std::function<void()> run) {
                                host_calls.emplace_back(std::move(queue), std::move(run));
                            },
                        .kernel_done =
                            [this](const KernelRecord& record) {
                                runs[*record.name] = {record.start.count(), record.end.count()};
                                order += *record.name;
                            }}) {}

    Engine::QueuePtr stream(Kind kind = Kind::kNonBlocking, std::uint64_t context = 1,
                            int device = 0) {
        return std::make_shared<StreamQueue>(next_id_++, kind, context, device);
    }

    Fence submit(const Engine::QueuePtr& queue, Work work, std::vector<Fence> fences = {}) {
        const std::uint64_t ticket = ++queue->submitted;
        engine.submit(queue, {std::move(work), std::move(fences), ticket});
        return {queue, ticket};
    }

    Fence kernel(const Engine::QueuePtr& queue, const std::string& name, std::uint64_t num_blocks,
                 std::int64_t block_ns, int priority = 0, int blocks_per_sm = 1) {
        KernelWork work;
        work.name = std::make_shared<const std::string>(name);
        work.num_blocks = num_blocks;
        work.block_time = Time{block_ns};
        work.priority = priority;
        work.blocks_per_sm = blocks_per_sm;
        return submit(queue, std::move(work));
    }

    void advance(std::int64_t ns) { engine.advance_to(Time{ns}); }

    Engine engine;
    std::map<std::string, Run> runs;
    std::string order;  ///< the kernels' names as they completed
    std::vector<std::pair<Engine::QueuePtr, std::function<void()>>> host_calls;

  private:
    std::uint64_t next_id_ = 1;
};

constexpr std::int64_t kLong = 1'000'000;

}  // namespace

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
