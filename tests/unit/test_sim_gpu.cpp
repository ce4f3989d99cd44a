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
                if (kernel.tag != 0) ends[static_cast<char>(kernel.tag)] = t.count();
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
    SECTION("on a busy GPU") {
        gpu.launch(1, 'x', 3);
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

TEST_CASE("A block that takes a whole multiprocessor shares it with nobody", "[unit][sim]") {
    Gpu gpu;
    const auto launch_whole = [&](int stream, char name, std::uint32_t blocks) {
        gpu.model.launch(stream, {blocks, 512, 100, 0, name});
    };
    SECTION("each runs as fast as alone") {
        launch_whole(0, 'a', 1);
        gpu.launch(1, 'b', 2);  // both on the other multiprocessor
        CHECK(gpu.run() == Ends{{'a', 100}, {'b', 200}});
    }
    SECTION("and waits for a free one, though there is room for its threads") {
        gpu.launch(0, 'a', 2);
        launch_whole(1, 'b', 1);
        CHECK(gpu.run() == Ends{{'a', 100}, {'b', 200}});
    }
    SECTION("whose last blocks may have less to do") {
        gpu.model.launch(0, {2, 512, 100, 0, 'a', false, nanoseconds{0}, 1, 75});
        gpu.launch(1, 'b', 1);
        CHECK(gpu.run() == Ends{{'a', 100}, {'b', 175}});
    }
}

TEST_CASE("A stream that joins another one waits for what is on it by then", "[unit][sim]") {
    Gpu gpu;
    gpu.launch(0, 'a', 1);
    gpu.launch(1, 'b', 1, 0, 300);
    SECTION("and what comes later on that one is not waited for") {
        gpu.model.join(0, 1);
        gpu.launch(0, 'c', 1);
        gpu.launch(1, 'd', 1, 0, 500);
        // Behind b and the gap between two kernels of one stream, beside d.
        const Ends ends = gpu.run();
        CHECK(ends.at('b') == 300);
        CHECK(ends.at('c') == 410);
        CHECK(ends.at('d') > ends.at('c'));
    }
    SECTION("of two that wait for each other in turn, the second waits for the first") {
        gpu.model.join(0, 1);
        gpu.model.join(2, 0);
        gpu.launch(2, 'c', 1);
        CHECK(gpu.run().at('c') == 410);
    }
    SECTION("and what is over already is not waited for") {
        gpu.run();
        gpu.model.join(0, 1);
        CHECK(gpu.model.ended(0) == gpu.model.launched(0));
    }
}

TEST_CASE("A mark kernel waits for a slot, and gets it before all others", "[unit][sim]") {
    Gpu gpu;
    gpu.launch(0, 'a', 4);  // every slot
    gpu.launch(1, 'b', 4, -1);
    gpu.model.launch(2, {.tag = 'm', .is_mark = true, .mark = nanoseconds{5}});
    gpu.model.launch(3, {.tag = 'e', .is_mark = true});
    CHECK(gpu.run() == Ends{{'a', 200}, {'b', 400}, {'m', 205}, {'e', 0}});
}

TEST_CASE("Behind a closed gate a stream waits until it is opened", "[unit][sim]") {
    Gpu gpu;
    const auto gate = [&](int stream, int word, std::uint32_t number) {
        gpu.model.launch(stream, {.mark = nanoseconds{3}, .word = word, .number = number});
    };
    gpu.launch(0, 'a', 2);
    gate(0, 7, 1);
    gpu.launch(0, 'b', 2);
    gate(0, 7, 2);
    gpu.launch(0, 'c', 2);
    SECTION("which is closed at first, and lets others pass") {
        gpu.launch(1, 'x', 2, 0, 300);  // beside a at half the speed
        CHECK(gpu.run() == Ends{{'a', 200}, {'x', 400}});
        gpu.model.open(7, 1, nanoseconds{5});
        CHECK(gpu.run() == Ends{{'b', 515}});  // 5 later, and the gap
        gpu.model.open(7, 2, nanoseconds{5});
        CHECK(gpu.run() == Ends{{'c', 630}});
    }
    SECTION("by a later number as well, and what is not reached yet takes what an open one does") {
        gpu.run();
        gpu.model.open(7, 2, nanoseconds{5});
        CHECK(gpu.run() == Ends{{'b', 215}, {'c', 328}});
    }
    SECTION("not by another word") {
        gpu.run();
        gpu.model.open(6, 2, nanoseconds{0});
        gpu.model.open(8, 2, nanoseconds{0});
        CHECK(gpu.run().empty());
        CHECK(gpu.model.ended(0) == 1);
    }
    SECTION("and all of them may be open before they are reached") {
        gpu.model.open(7, 2, nanoseconds{5});
        CHECK(gpu.run() == Ends{{'a', 100}, {'b', 213}, {'c', 326}});
    }
}

TEST_CASE("A closed gate holds its connection", "[unit][sim]") {
    Gpu one(1), two(2);
    for (Gpu* gpu : {&one, &two}) {
        gpu->model.launch(0, {.word = 0, .number = 1});
        gpu->launch(1, 'b', 2);  // in the queue behind it, or in one of its own
        gpu->launch(0, 'a', 2);
    }
    CHECK(one.run().empty());
    CHECK(two.run() == Ends{{'b', 100}});
    one.model.open(0, 1, nanoseconds{4});
    // b at 4, a behind the gap at 14 beside it, each at half the speed meanwhile.
    CHECK(one.run() == Ends{{'b', 194}, {'a', 204}});
}
