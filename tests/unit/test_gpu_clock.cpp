// SPDX-License-Identifier: Apache-2.0
#include "host/model/gpu_clock.h"

#include <atomic>
#include <memory>
#include <random>
#include <thread>
#include <vector>

#include "tests/support/catch.h"
#include "tests/support/virtual_stream.h"

using namespace urgengo;
using namespace std::chrono_literals;
using model::GpuClock;
using model::nanoseconds;
using testing::VirtualTimer;

namespace {

nanoseconds between(std::mt19937& random, nanoseconds low, nanoseconds high) {
    return nanoseconds(
        std::uniform_int_distribution<std::int64_t>(low.count(), high.count())(random));
}

// A mark that ran at `ran`: often behind other work, now and then on an idle GPU; polled for, or
// found by chance.
GpuClock::Pair pair_at(std::mt19937& random, const VirtualTimer& timer, nanoseconds ran) {
    const bool idle = random() % 8 == 0, polled = random() % 4 == 0;
    return {timer.stamp(ran), ran - between(random, 3us, idle ? 6us : 1ms),
            ran + between(random, 1us, polled ? 3us : 300us)};
}

bool holds(const GpuClock& clock, const VirtualTimer& timer, nanoseconds ran) {
    const auto told = clock.to_host(timer.stamp(ran));
    return told && std::chrono::abs(told->time - ran) <= told->error;
}

}  // namespace

TEST_CASE("GpuClock knows a stamp within its pair's bounds after one pair", "[model][gpu_clock]") {
    GpuClock clock;
    CHECK_FALSE(clock.to_host(5'000));
    CHECK(clock.add({5'000, 100us, 106us}) == GpuClock::Update::kRestarted);
    const auto told = clock.to_host(5'000);
    REQUIRE(told);
    CHECK(told->time == 103us);
    CHECK(told->error == 3us + GpuClock::kGranularity);
    // Carried on: 1 ms later it may be 600 ns more off.
    const auto later = clock.to_host(1'005'000);
    CHECK(later->time == 1103us);
    CHECK(later->error == told->error + 600ns);
    CHECK(clock.add({5'000, 106us, 100us}) == GpuClock::Update::kSkipped);
}

TEST_CASE("GpuClock holds its error bound for any drift, granularity and queue",
          "[model][gpu_clock]") {
    std::mt19937 random(20261121);
    for (std::int64_t granularity_ns : {32, 1'000, 1'024}) {
        for (double ppm : {-180.0, -20.0, 0.0, 3.0, 90.0}) {
            INFO("granularity " << granularity_ns << " ns, drift " << ppm << " ppm");
            VirtualTimer timer{};
            timer.ppm = ppm;
            timer.granularity_ns = granularity_ns;
            GpuClock clock;
            nanoseconds now = 1s;
            int outside = 0;
            for (int i = 0; i < 20'000; ++i) {
                now += between(random, 50us, 3ms);
                clock.add(pair_at(random, timer, now));
                outside += !holds(clock, timer, now + between(random, -2ms, 20ms));
            }
            CHECK(outside == 0);
            CHECK(clock.restarts() == 1);
            CHECK(std::abs(clock.drift().ppm + ppm) < 10);
            CHECK(clock.to_host(timer.stamp(now))->error < 6us);
        }
    }
}

TEST_CASE("GpuClock stays good through a pause once it knows the drift", "[model][gpu_clock]") {
    std::mt19937 random(1);
    VirtualTimer timer{};
    timer.ppm = 60;
    GpuClock clock;
    nanoseconds now = 1s;
    for (int i = 0; i < 20'000; ++i)
        clock.add(pair_at(random, timer, now += between(random, 100us, 2ms)));
    const auto told = clock.to_host(timer.stamp(now + 1s));
    CHECK(std::chrono::abs(told->time - (now + 1s)) <= told->error);
    CHECK(told->error < 20us);  // 600 us without
}

TEST_CASE("GpuClock learns how coarse the count is from its stamps", "[model][gpu_clock]") {
    std::mt19937 random(2);
    VirtualTimer timer{};
    timer.granularity_ns = 8'000;
    GpuClock clock;
    nanoseconds now = 1s;
    int outside = 0;
    for (int i = 0; i < 20'000; ++i) {
        now += between(random, 100us, 2ms);
        clock.add(pair_at(random, timer, now));
        outside += i >= 20 && !holds(clock, timer, now);
    }
    CHECK(clock.restarts() == 1);
    CHECK(outside == 0);
    CHECK(clock.to_host(timer.stamp(now))->error < 16us);
}

TEST_CASE("GpuClock takes the count to be coarser when pairs contradict it a little",
          "[model][gpu_clock]") {
    GpuClock clock;
    clock.add({1'000'000, 1ms, 1ms});
    // The count stood still for 3 us; 600 ns may be drift.
    CHECK(clock.add({2'000'032, 2003us + 32ns, 2003us + 32ns}) == GpuClock::Update::kCoarsened);
    CHECK(clock.add({3'000'064, 3003us, 3003us}) == GpuClock::Update::kRefined);
    CHECK(clock.restarts() == 1);
    const auto told = clock.to_host(3'000'064);
    CHECK(told->error > 1us);
    CHECK(std::chrono::abs(told->time - 3003us) <= told->error);
}

TEST_CASE("GpuClock begins anew when a clock was stopped or began anew", "[model][gpu_clock]") {
    std::mt19937 random(3);
    VirtualTimer timer{};
    timer.ppm = 15;
    GpuClock clock;
    nanoseconds now = 1s;
    std::uint32_t restarts = 0;
    for (std::int64_t step_ns :
         {0ll, 5'000'000'000ll, -7'000'000'000ll, -900'000'000'000ll, 400'000ll}) {
        timer.epoch_ns += step_ns;
        ++restarts;
        for (int i = 0; i < 5'000; ++i) {
            now += between(random, 100us, 2ms);
            clock.add(pair_at(random, timer, now));
            // A small step shows at the first tight pair; a large one at once.
            if (i >= 50 || std::abs(step_ns) > 1'000'000) REQUIRE(holds(clock, timer, now));
        }
        CHECK(clock.restarts() == restarts);
        CHECK(clock.to_host(timer.stamp(now))->error < 6us);
    }
}

TEST_CASE("GpuClock follows a host clock that is slewed faster than any may be",
          "[model][gpu_clock]") {
    std::mt19937 random(4);
    VirtualTimer timer{};
    timer.ppm = 2'000;
    GpuClock clock;
    nanoseconds now = 1s;
    nanoseconds worst{0};
    for (int i = 0; i < 10'000; ++i) {
        now += between(random, 100us, 2ms);
        clock.add(pair_at(random, timer, now));
        const auto told = clock.to_host(timer.stamp(now));
        worst = std::max<nanoseconds>(worst, std::chrono::abs(told->time - now));
    }
    CHECK(worst < 600us);  // never worse than one loose pair
}

TEST_CASE("GpuClock follows stamps across the wrap of their 48 bits", "[model][gpu_clock]") {
    std::mt19937 random(5);
    VirtualTimer timer{};
    timer.epoch_ns = (std::int64_t{1} << 48) - 2'000'000'000;
    GpuClock clock;
    for (nanoseconds now = 1s; now < 4s; now += 1ms) {
        clock.add(pair_at(random, timer, now));
        REQUIRE(holds(clock, timer, now + 3ms));
        REQUIRE(holds(clock, timer, now - 3ms));
    }
    CHECK(clock.restarts() == 1);
}

TEST_CASE("GpuClock takes marks that are seen out of order", "[model][gpu_clock]") {
    std::mt19937 random(6);
    VirtualTimer timer{};
    timer.ppm = 40;
    GpuClock clock;
    for (nanoseconds now = 1s; now < 9s; now += 1ms) {
        clock.add(pair_at(random, timer, now - between(random, 0ns, 20ms)));
        REQUIRE(holds(clock, timer, now));
    }
    CHECK(clock.restarts() == 1);
    CHECK(clock.to_host(timer.stamp(9s))->error < 6us);
}

TEST_CASE("GpuClock is read whole while others give pairs", "[model][gpu_clock][threads]") {
    // Pairs 100 ms apart and exact: a copy made of two different ones would be as much off.
    const auto clock = std::make_unique<GpuClock>();
    const auto pair = [](std::int64_t i) {
        const nanoseconds ran(i * 100'000'000);
        return GpuClock::Pair{static_cast<std::uint64_t>(ran.count() + 77'000), ran, ran};
    };
    constexpr std::int64_t kPairs = 1'000'000;
    std::atomic<std::int64_t> next{2};
    clock->add(pair(1));
    std::atomic<int> outside{0}, read{0};
    const auto reader = [&] {
        for (std::int64_t i = 0; i < kPairs; i = next.load(std::memory_order_relaxed)) {
            const auto told = clock->to_host(pair(i).stamp);
            if (!told) continue;
            read.fetch_add(1, std::memory_order_relaxed);
            if (std::chrono::abs(told->time - pair(i).seen) > told->error)
                outside.fetch_add(1, std::memory_order_relaxed);
        }
    };
    const auto writer = [&] {
        for (std::int64_t i = 0; i < kPairs; i = next.fetch_add(1, std::memory_order_relaxed))
            if (i > 1) clock->add(pair(i));
    };
    std::vector<std::thread> threads;
    threads.emplace_back(reader);
    threads.emplace_back(reader);
    threads.emplace_back(writer);
    threads.emplace_back(writer);
    for (std::thread& t : threads) t.join();
    CHECK(outside == 0);
    CHECK(read > 0);
    CHECK(clock->restarts() == 1);
}
