// SPDX-License-Identifier: Apache-2.0
//
// The simulator's GPU, with times reckoned by hand: two multiprocessors of two blocks each.
#include <map>

#include "tests/support/catch.h"
#include "tools/sim/gpu_model.h"

using namespace urgengo::sim;

namespace {

struct Gpu {
    explicit Gpu(int connections = 4)
        : model({2, 512, nanoseconds{10}, nanoseconds{20}, connections, nanoseconds{0}}) {
        for (int i = 0; i < 4; ++i) model.add_stream();
    }
    /// Its tag is its name.
    void launch(int stream, char name, std::uint32_t blocks, int priority = 0,
                double block_ns = 100) {
        model.launch(stream, {blocks, 256, block_ns, priority, name});
    }
    /// @returns when each kernel ends
    std::map<char, std::int64_t> run() {
        std::map<char, std::int64_t> ends;
        for (nanoseconds t = model.next(); t != kNever; t = model.next())
            for (const EndedKernel& kernel : model.advance(t))
                ends[static_cast<char>(kernel.tag)] = t.count();
        return ends;
    }

    GpuModel model;
};

using Ends = std::map<char, std::int64_t>;

}  // namespace

TEST_CASE("A kernel alone takes what its fullest multiprocessor takes", "[unit][sim]") {
    const GpuShape shape{2, 512, {}, {}, 1, {}};
    for (const auto& [blocks, end] : std::map<std::uint32_t, std::int64_t>{
             {1, 100}, {2, 100}, {3, 200}, {4, 200}, {5, 300}, {8, 400}}) {
        Gpu gpu;
        gpu.launch(0, 'a', blocks);
        INFO(blocks << " blocks");
        CHECK(gpu.run() == Ends{{'a', end}});
        CHECK(GpuModel::time_alone_ns(shape, blocks, 256, 100) == double(end));
    }
}

TEST_CASE("Kernels together fill what each leaves empty, and share what both want", "[unit][sim]") {
    Gpu gpu;
    SECTION("a block each, on a multiprocessor of its own") {
        gpu.launch(0, 'a', 1);
        gpu.launch(1, 'b', 1);
        CHECK(gpu.run() == Ends{{'a', 100}, {'b', 100}});
    }
    SECTION("two blocks on each multiprocessor are half as fast") {
        gpu.launch(0, 'a', 2);
        gpu.launch(1, 'b', 2);
        CHECK(gpu.run() == Ends{{'a', 200}, {'b', 200}});
    }
    SECTION("who remains is as fast as alone") {
        gpu.launch(0, 'a', 2);
        gpu.launch(1, 'b', 2, 0, 150);
        CHECK(gpu.run() == Ends{{'a', 200}, {'b', 250}});
    }
    SECTION("who finds no room for some of its blocks starts those later") {
        gpu.launch(0, 'a', 3);
        gpu.launch(1, 'b', 2);  // one beside a, at half the speed; the other one then
        CHECK(gpu.run() == Ends{{'a', 200}, {'b', 300}});
    }
}

TEST_CASE("A more urgent kernel overtakes what waits, and nothing that runs", "[unit][sim]") {
    Gpu gpu;
    gpu.launch(0, 'a', 4);
    gpu.launch(1, 'b', 4);
    gpu.launch(2, 'c', 4, -1);
    CHECK(gpu.run() == Ends{{'a', 200}, {'c', 400}, {'b', 600}});
}

TEST_CASE("Kernels of a stream are a gap apart, a longer one while others run", "[unit][sim]") {
    Gpu gpu;
    gpu.launch(0, 'a', 4);
    gpu.launch(0, 'b', 2);
    SECTION("alone") {
        CHECK(gpu.run() == Ends{{'a', 200}, {'b', 310}});
    }
    SECTION("beside another stream's") {
        gpu.launch(1, 'x', 4, 0, 200);  // from 200 to 600, on all of it: b comes into no room
        CHECK(gpu.run() == Ends{{'a', 200}, {'x', 600}, {'b', 700}});
    }
    SECTION("beside another stream's that leaves room") {
        gpu.launch(1, 'x', 2, 0, 200);  // at 200; b at 220, beside it at half the speed
        CHECK(gpu.run() == Ends{{'a', 200}, {'b', 420}, {'x', 500}});
    }
}

TEST_CASE("Behind a stream that waits, a connection lets nobody pass", "[unit][sim]") {
    Gpu one(1), two(2);
    for (Gpu* gpu : {&one, &two}) {
        gpu->launch(0, 'a', 2);
        gpu->launch(0, 'b', 2);  // waits for a
        gpu->launch(1, 'c', 2);  // in the queue behind it, or in one of its own
    }
    // c at 100, b at 110 beside it, each at half the speed until c has had its 90 more.
    CHECK(one.run() == Ends{{'a', 100}, {'c', 290}, {'b', 300}});
    CHECK(two.run() == Ends{{'a', 200}, {'c', 200}, {'b', 310}});
}

TEST_CASE("A mark takes its own time of its stream, and an event none", "[unit][sim]") {
    Gpu gpu;
    const auto mark = [&](int stream, char name, nanoseconds time) {
        gpu.model.launch(stream, {.tag = name, .is_mark = true, .mark = time});
    };
    SECTION("alone") {
        gpu.launch(0, 'a', 2);
        mark(0, 'm', nanoseconds{7});
        gpu.launch(0, 'b', 2);
        CHECK(gpu.run() == Ends{{'a', 100}, {'m', 107}, {'b', 217}});
    }
    SECTION("on a full GPU") {
        gpu.launch(1, 'x', 4);
        mark(0, 'm', nanoseconds{7});
        CHECK(gpu.run() == Ends{{'m', 7}, {'x', 200}});
    }
    SECTION("an event") {
        gpu.launch(0, 'a', 2);
        mark(0, 'e', nanoseconds{0});
        gpu.launch(0, 'b', 2);
        CHECK(gpu.run() == Ends{{'a', 100}, {'e', 100}, {'b', 210}});
    }
}

TEST_CASE("A kernel starts no sooner than the GPU can hear of it", "[unit][sim]") {
    GpuModel model({2, 512, nanoseconds{10}, nanoseconds{20}, 4, nanoseconds{30}});
    model.add_stream();
    model.launch(0, {2, 256, 100});
    model.launch(0, {2, 256, 100});
    std::vector<std::int64_t> ends;
    for (nanoseconds t = model.next(); t != kNever; t = model.next())
        for ([[maybe_unused]] const EndedKernel& kernel : model.advance(t))
            ends.push_back(t.count());
    CHECK(ends == std::vector<std::int64_t>{130, 240});  // the second has been heard of long since
}
