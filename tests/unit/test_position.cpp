// SPDX-License-Identifier: Apache-2.0
#include "host/model/position.h"

#include <atomic>
#include <memory>
#include <thread>
#include <vector>

#include "tests/support/catch.h"
#include "tests/support/virtual_stream.h"

using namespace urgengo;
using namespace std::chrono_literals;
using model::locate;
using model::nanoseconds;
using model::Position;
using model::Tempo;
using testing::launch_instance;
using testing::VirtualInstance;
using testing::VirtualStream;

namespace {

// Ten launches of 50 us, put down at once, and marks behind the fifth and the last.
struct TwoSpans {
    explicit TwoSpans(std::uint32_t first_launch = 0, std::uint32_t first_mark = 0)
        : stream(first_launch, first_mark) {}

    VirtualStream stream;
    void launch(nanoseconds truth, bool lose_last = false) {
        for (std::uint32_t i = 0; i < 10; ++i) {
            stream.launch(1ms + i * 1us, truth, 50us, i);
            if (i % 5 == 4) stream.mark(1ms + i * 1us, lose_last && i == 9);
        }
    }
    Position at(nanoseconds now, const Tempo& tempo = {}) {
        stream.move_to(now);
        const auto p = locate(stream.log, stream.seen(), tempo, now);
        REQUIRE(p);
        return *p;
    }
};

}  // namespace

TEST_CASE("read_mark tells the mark in the line, unless it is torn", "[model][position]") {
    ug_mark_line line{};
    for (std::uint32_t sequence : {5u, 65'535u, 65'536u, 0xffff'ffffu, 0u, 3u}) {
        line.word[0] = ug_mark_word0(0xfedc'ba98u, 0x1234, sequence);
        line.word[1] = 0x1234'5678'9abcull << 16 | (sequence & 0xffff);
        for (std::uint32_t ahead : {0u, 1u, 30'000u}) {
            const auto mark = model::read_mark(line, sequence + ahead);
            REQUIRE(mark);
            CHECK(mark->sequence == sequence);
            CHECK(mark->position == 0xfedc'ba98u);
            CHECK(mark->instance == 0x1234);
            CHECK(mark->stamp == 0x1234'5678'9abcull);
        }
    }
    line.word[1] ^= 1;
    CHECK_FALSE(model::read_mark(line, 3));
}

TEST_CASE("Position does not pass a mark that has not run", "[model][position]") {
    TwoSpans t;
    t.launch(500us);  // ten times as long as thought
    const Position p = t.at(1ms + 2400us);
    CHECK(p.busy);
    CHECK(p.launch == 4);
    CHECK(p.executed == 250us);
    CHECK(p.unexecuted == 250us);
    CHECK(p.uncertain == 250us);
    CHECK(p.overdue);                         // by 2 * 250 us and 1 ms
    CHECK_FALSE(t.at(1ms + 2520us).overdue);  // the mark has run
    CHECK(t.at(1ms + 2520us).launch == 5);
}

TEST_CASE("Something remains of a kernel that shares the GPU when it should be over",
          "[model][position]") {
    TwoSpans t;
    t.launch(500us);  // ten times as long as thought
    const auto at = [&](nanoseconds since) {
        const Position alone = t.at(1ms + 3us + since),
                       shared = t.at(1ms + 3us + since, {1, 0ns, true});
        CHECK(shared.launch == alone.launch);
        CHECK(shared.unexecuted + shared.executed == 500us);
        CHECK(shared.executed <= alone.executed);
        return shared.executed;
    };
    CHECK(at(30us) == 30us);
    CHECK(at(49us) > 43us);  // of 50
    CHECK(at(49us) < 46us);
    CHECK(at(60us) == 60us);  // of the next one: 10
    // The last one before the mark that does not come: ever less of it.
    CHECK(at(250us) > 243us);
    CHECK(at(260us) > at(250us));
    CHECK(at(260us) < 250us);
    CHECK(at(1ms) <= 250us);
    CHECK(at(1ms) > 249us);
}

TEST_CASE("A kernel that shares the GPU runs at two thirds of its speed at least",
          "[model][position]") {
    TwoSpans t;
    t.launch(500us);
    // A quarter of the speed: of 50 us, 10 have passed in 40; at the least of paces 40 / 1.5.
    const Position p = t.at(1ms + 3us + 40us, {4, 0ns, true});
    CHECK(p.launch == 0);
    CHECK(p.executed > 26us);
    CHECK(p.executed < 27us);
    CHECK(t.at(1ms + 3us + 41us, {4, 0ns, false}).executed < 11us);
}

TEST_CASE("Position does not pass what was launched, and is idle behind it", "[model][position]") {
    VirtualStream stream;
    stream.launch(1ms, 300us, 100us, 0);
    stream.launch(1002us, 300us, 100us, 1);
    stream.move_to(1050us);
    auto p = locate(stream.log, {}, {}, 1050us);
    CHECK(p->busy);
    CHECK(p->launch == 0);
    CHECK(p->executed == 47us);
    CHECK(p->unexecuted == 153us);
    p = locate(stream.log, {}, {}, 1500us);
    CHECK_FALSE(p->busy);
    CHECK(p->launch == 2);
    CHECK(p->position == 2);
    CHECK(p->unexecuted == 0ns);
    CHECK_FALSE(p->overdue);
    CHECK(locate(stream.log, {}, {}, 3ms)->overdue);
}

TEST_CASE("Position of a task that never launched is its first launch", "[model][position]") {
    const auto log = std::make_unique<model::LaunchLog>();
    const auto p = locate(*log, {}, {}, 1s);
    REQUIRE(p);
    CHECK_FALSE(p->busy);
    CHECK(p->launch == 0);
    CHECK(p->position == 0);
    CHECK(p->unexecuted == 0ns);
}

TEST_CASE("Position waits for launches that come late", "[model][position]") {
    VirtualStream stream;
    for (std::uint32_t i = 0; i < 5; ++i)  // 10 us of work every 100 us
        stream.launch(1ms + i * 100us, 10us, 10us, i);
    stream.mark(1ms + 401us);
    stream.move_to(1ms + 405us);
    const auto p = locate(stream.log, stream.seen(), {}, 1ms + 405us);
    CHECK(p->busy);
    CHECK(p->launch == 4);
    CHECK(p->executed == 42us);
}

TEST_CASE("Position of a starved task does not run away", "[model][position]") {
    TwoSpans t;
    t.stream.others(1103us, 6103us);  // after two kernels
    t.launch(50us);
    CHECK(t.at(1080us).launch == 1);
    CHECK(t.at(5ms).launch == 4);  // as far as the next mark allows, and no further
    CHECK(t.at(5ms).overdue);
    Tempo tempo;
    tempo.stalled = 5ms - 1103us;
    CHECK(t.at(5ms, tempo).launch == 2);
    CHECK_FALSE(t.at(5ms, tempo).overdue);
    tempo.stalled = 5ms;
    CHECK(t.at(6103us + 60us, tempo).launch == 3);
    CHECK(t.at(6103us + 170us).launch == 5);  // the mark behind launch 4 has run
}

TEST_CASE("Position is right behind a mark that was lost", "[model][position]") {
    VirtualStream stream;
    for (std::uint32_t i = 0; i < 10; ++i) {
        stream.launch(1ms + i * 1us, 50us, 50us, i);
        if (i == 4 || i == 7) stream.mark(1ms + i * 1us, i == 4);
    }
    stream.move_to(1330us);  // the GPU is at launch 6; the mark behind 4 never came
    auto p = locate(stream.log, stream.seen(), {}, 1330us);
    CHECK(p->launch == 4);
    stream.move_to(1410us);
    p = locate(stream.log, stream.seen(), {}, 1420us);
    CHECK(p->launch == 8);
    CHECK_FALSE(p->overdue);

    TwoSpans t;
    t.launch(50us, true);  // the last one, as when the context is lost
    CHECK(t.at(5ms).launch == 9);
    CHECK(t.at(5ms).overdue);
}

TEST_CASE("Position is the same across the wrap of launches, marks and tags", "[model][position]") {
    for (const auto& [launch, mark] :
         {std::pair{0xffff'fffcu, 0xffff'ffffu}, std::pair{0xffff'fff0u, 65'535u},
          std::pair{7u, 65'534u}, std::pair{7u, 0xffff'fffeu}}) {
        for (nanoseconds truth : {50us, 200us}) {
            TwoSpans from_zero, wrapping(launch, mark);
            from_zero.launch(truth);
            wrapping.launch(truth);
            for (nanoseconds now = 1ms; now < 3200us; now += 7us) {
                const Position a = from_zero.at(now), b = wrapping.at(now);
                REQUIRE(a.launch == b.launch - launch);
                REQUIRE(a.executed == b.executed);
                REQUIRE(a.unexecuted == b.unexecuted);
                REQUIRE(a.busy == b.busy);
                REQUIRE(a.overdue == b.overdue);
            }
        }
    }
}

TEST_CASE("Position says whose launch it is while instances overlap", "[model][position]") {
    VirtualStream stream;
    for (std::uint16_t instance = 41; instance <= 42; ++instance)
        for (std::uint32_t i = 0; i < 4; ++i) stream.launch(1ms, 50us, 50us, i, instance);
    stream.mark(1ms);
    stream.move_to(1ms);
    const auto at = [&](nanoseconds now) {
        stream.move_to(now);
        return *locate(stream.log, stream.seen(), {}, now);
    };
    CHECK(at(1003us + 170us).instance == 41);
    CHECK(at(1003us + 170us).position == 3);
    CHECK(at(1003us + 220us).instance == 42);
    CHECK(at(1003us + 220us).position == 0);
    CHECK(at(1003us + 270us).position == 1);
    // All done: what comes next is not known to be another instance's.
    CHECK(at(1500us).instance == 42);
    CHECK(at(1500us).position == 4);
}

TEST_CASE("Position passes over marks with nothing between them", "[model][position]") {
    VirtualStream stream;
    stream.mark(1ms);
    stream.mark(1ms);
    stream.launch(1ms, 50us, 50us, 0);
    stream.mark(1ms);
    stream.launch(1ms, 50us, 50us, 1);
    stream.mark(1ms);
    stream.move_to(1002us);
    const auto p = locate(stream.log, {0, 0ns}, {}, 1020us);
    CHECK(p->launch == 0);
    CHECK(p->uncertain == 50us);
}

TEST_CASE("Position starts from what the rings still hold", "[model][position]") {
    VirtualStream stream;
    for (std::uint32_t i = 0; i < 3 * model::LaunchLog::kLaunches; ++i) {
        stream.launch(1ms, 1us, 1us, i);
        if (i % 10 == 9) stream.mark(1ms);
    }
    stream.move_to(1ms);  // 307 marks in flight, of which the ring holds 64
    const auto p = locate(stream.log, {0, 0ns}, {}, 1ms);
    REQUIRE(p);
    CHECK(p->launch == (307 - abi::kMarkRing + 2) * 10);

    VirtualStream unmarked;
    for (std::uint32_t i = 0; i < 3 * model::LaunchLog::kLaunches; ++i)
        unmarked.launch(1ms, 1us, 1us, i);
    unmarked.move_to(1ms);
    const auto q = locate(unmarked.log, {0, 0ns}, {}, 1ms);
    REQUIRE(q);
    CHECK(q->launch == 2 * model::LaunchLog::kLaunches + 2);
    CHECK(q->executed == q->launch * 1us);
}

TEST_CASE("Position is read whole while the task launches", "[model][position][threads]") {
    const auto log = std::make_unique<model::LaunchLog>();
    std::atomic<bool> stop{false};
    std::atomic<int> read{0}, wrong{0};
    std::thread reader([&] {
        while (!stop.load(std::memory_order_relaxed)) {
            // No mark has ever run: the whole ring is in question, and turns under the reader.
            const nanoseconds now(read.load(std::memory_order_relaxed) % 4000);
            const auto p = locate(*log, {log->last_mark(), 0ns}, {}, now);
            if (!p) continue;
            read.fetch_add(1, std::memory_order_relaxed);
            if (p->position != p->launch || p->executed > 10ns * p->launch + 10ns)
                wrong.fetch_add(1, std::memory_order_relaxed);
        }
    });
    // On a busy machine the reader may get no core for a while.
    const auto goes_on = [&](std::uint32_t n) {
        return n < 3'000'000 || (read.load(std::memory_order_relaxed) == 0 && n < 1'000'000'000);
    };
    for (std::uint32_t n = 0; goes_on(n); ++n) {
        log->launched(10ns, {0ns, 0ns, 1, n, 0});
        if (n % 700 == 699) log->marked(0ns, log->last_mark() + 1);
    }
    stop = true;
    reader.join();
    CHECK(wrong == 0);
    CHECK(read > 0);
}
