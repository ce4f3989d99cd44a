// SPDX-License-Identifier: Apache-2.0
//
// The guard in virtual time, beside a program that is made of chances
// (tests/support/guard_world.h).
#include "host/sched/guard.h"

#include <algorithm>
#include <random>

#include "tests/support/catch.h"
#include "tests/support/guard_world.h"

using namespace urgengo::sched;
using namespace urgengo::testing;
using namespace std::chrono_literals;

namespace {

constexpr std::size_t kChains = 8;

}  // namespace

TEST_CASE("Guard falls back within seconds when scheduling harms", "[sched][guard]") {
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
        CAPTURE(seed);
        World world(kChains, seed, [](auto chain, auto& guard, auto, auto& random) {
            return with_late(guard.mode(chain) == GuardMode::kEnforce ? 0.5 : 0.0, random);
        });
        world.run_to(12s);
        CHECK(world.all_settled(GuardMode::kPriorities));
        CHECK(world.guard->num_fallbacks() == 1);
        // From there on it tries again, seldom, and at the cost of a few frames.
        world.forget();
        world.run_to(120s);
        CHECK(world.late_share() < 0.01);
        CHECK(world.all_settled(GuardMode::kPriorities));
        CHECK(world.guard->num_comparisons() <= 8);
    }
}

TEST_CASE("Guard goes by a chain's period as it is now", "[sched][guard]") {
    // How many late frames of one chain it takes.
    const auto frames_until_compared = [](Guard guard, bool is_told) {
        if (is_told) guard.describe(0, 50ms);
        int frames = 0;
        for (nanoseconds at = 1s; !guard.is_comparing() && frames < 1000; at += 50ms, ++frames) {
            guard.frame_began(0, at, 50ms);
            guard.frame_ended(0, 75ms, 50ms, at + 75ms);
        }
        return frames;
    };
    const int usual = frames_until_compared(Guard({50ms}), false);
    CHECK(frames_until_compared(Guard({2s}), true) == usual);
    CHECK(frames_until_compared(Guard({2s}), false) != usual);
}

TEST_CASE("Guard seldom goes on to do nothing where less was worse", "[sched][guard]") {
    int num_observed = 0;
    for (std::uint64_t seed = 1; seed <= 40; ++seed) {
        bool observed = false;
        World world(kChains, seed, [&](auto chain, auto& guard, auto, auto& random) {
            observed = observed || guard.mode(chain) == GuardMode::kObserve;
            return with_late(guard.mode(chain) == GuardMode::kEnforce ? 0.3 : 0.45, random);
        });
        world.run_to(60s);
        CHECK(world.guard->num_comparisons() > 0);
        num_observed += observed;
    }
    CHECK(num_observed <= 2);
}

TEST_CASE("Guard decides in a few seconds when the harm is large", "[sched][guard]") {
    struct Case {
        double with, without;
        nanoseconds warm_up;  ///< most frames are late meanwhile, whoever schedules
        nanoseconds first, step;
        double median_s, most_s;  ///< of the time until it falls back, after the warm-up
    };
    const Case c = GENERATE(values<Case>({{0.13, 0.014, 0s, 20ms, 11ms, 12, 15},
                                          {0.13, 0.014, 4s, 20ms, 11ms, 12, 15},
                                          {0.13, 0.014, 0s, 50ms, 12ms, 13, 17},
                                          {0.45, 0.05, 0s, 20ms, 11ms, 5, 7},
                                          {0.45, 0.05, 4s, 20ms, 11ms, 6, 10},
                                          {0.45, 0.05, 0s, 50ms, 12ms, 6, 8}}));
    Durations took;
    for (std::uint64_t seed = 1; seed <= 41; ++seed) {
        World world(
            kChains, seed,
            [=](auto chain, auto& guard, auto now, auto& random) {
                if (now < 1s + c.warm_up) return 2 * with_late(0.6, random);
                const bool enforced = guard.mode(chain) == GuardMode::kEnforce;
                return with_late(enforced ? c.with : c.without, random);
            },
            c.first, c.step);
        nanoseconds end = 1s + c.warm_up;
        world.run_to(end);
        while (world.guard->num_fallen() == 0 && end < 90s) world.run_to(end += 100ms);
        took.add(end - 1s - c.warm_up);
    }
    WARN("late " << c.with << ", without " << c.without << ", warm-up "
                 << c.warm_up.count() / 1'000'000'000 << " s, periods from "
                 << c.first.count() / 1'000'000 << " ms: fell back after " << took);
    CHECK(took.median_s() <= c.median_s);
    CHECK(took.nine_of_ten_s() <= c.most_s);
}

TEST_CASE("Guard hardly disturbs a program that misses 1 %", "[sched][guard]") {
    const nanoseconds first = GENERATE(20ms, 50ms);
    double late = 0;
    std::size_t comparisons = 0;
    const int runs = 50;
    for (std::uint64_t seed = 1; seed <= runs; ++seed) {
        World world(
            kChains, seed,
            [](auto chain, auto& guard, auto, auto& random) {
                return with_late(guard.mode(chain) == GuardMode::kEnforce ? 0.01 : 0.15, random);
            },
            first, 12ms);
        world.run_to(60s);
        late += world.late_share() / runs;
        comparisons += world.guard->num_comparisons();
    }
    WARN("late 0.01: " << late << " with " << comparisons << " comparisons in " << runs
                       << " runs of 60 s");
    CHECK(comparisons <= static_cast<std::size_t>(runs));
    CHECK(late < 0.0125);
}

TEST_CASE("Guard goes on to observe when priorities harm as well", "[sched][guard]") {
    World world(kChains, 1, [](auto chain, auto& guard, auto, auto& random) {
        return with_late(guard.mode(chain) == GuardMode::kObserve ? 0.0 : 0.4, random);
    });
    world.run_to(30s);
    CHECK(world.all_settled(GuardMode::kObserve));
    world.forget();
    world.run_to(120s);
    CHECK(world.late_share() < 0.02);
}

TEST_CASE("Guard goes on to observe at once when priorities harm, but less", "[sched][guard]") {
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
        CAPTURE(seed);
        World world(kChains, seed, [](auto chain, auto& guard, auto, auto& random) {
            constexpr double kLate[] = {0.9, 0.6, 0.0};
            return with_late(kLate[static_cast<std::size_t>(guard.mode(chain))], random);
        });
        world.run_to(14s);
        CHECK(world.all_settled(GuardMode::kObserve));
    }
}

TEST_CASE("Guard goes on to observe with a chain that has only priorities and is late",
          "[sched][guard]") {
    int observes = 0;
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
        World world(kChains, seed, [](auto chain, auto& guard, auto, auto& random) {
            constexpr double kLate[] = {0.9, 0.6, 0.0};
            const auto mode = static_cast<std::size_t>(guard.mode(chain));
            return with_late(chain == 3 ? kLate[mode] : mode == 0 ? 0.0 : 0.4, random);
        });
        world.run_to(32s);
        observes += world.guard->settled(3).mode == GuardMode::kObserve;
        CHECK(world.guard->num_fallen() <= 1);
    }
    CHECK(observes >= 8);
}

TEST_CASE("Guard stays in enforce and hardly explores when scheduling helps", "[sched][guard]") {
    const auto [with, without] =
        GENERATE(table<double, double>({{0.002, 0.12}, {0.014, 0.2}, {0.1, 0.4}, {0.3, 0.6}}));
    double late = 0;
    const int runs = 20;
    for (std::uint64_t seed = 1; seed <= runs; ++seed) {
        World world(kChains, seed, [=](auto chain, auto& guard, auto, auto& random) {
            return with_late(guard.mode(chain) == GuardMode::kEnforce ? with : without, random);
        });
        world.run_to(60s);
        CHECK(world.all_settled(GuardMode::kEnforce));
        late += world.late_share() / runs;
    }
    CAPTURE(with, without, late);
    CHECK(late < 1.05 * with + 0.004);
}

TEST_CASE("Guard does not take frames that are just in time for late ones", "[sched][guard]") {
    for (std::uint64_t seed = 1; seed <= 20; ++seed) {
        CAPTURE(seed);
        World world(kChains, seed, [](auto chain, auto& guard, auto, auto& random) {
            if (guard.mode(chain) != GuardMode::kEnforce) return with_late(0.3, random);
            // As chains end that give way to others as long as they can.
            const double ratio = with_late(0.1, random);
            return ratio > 1 ? ratio : 0.85 + 0.1 * ratio;
        });
        world.run_to(60s);
        CHECK(world.guard->num_comparisons() > 0);
        CHECK(world.all_settled(GuardMode::kEnforce));
    }
}

TEST_CASE("Guard tries for a window what is plainly worse", "[sched][guard]") {
    nanoseconds tried{0};
    std::size_t comparisons = 0;
    for (std::uint64_t seed = 1; seed <= 40; ++seed) {
        nanoseconds before{0};
        World world(kChains, seed, [&](auto chain, auto& guard, auto now, auto& random) {
            const bool is_tried = guard.mode(chain) != GuardMode::kEnforce;
            if (is_tried) tried += now - before;
            before = now;
            return with_late(is_tried ? 0.5 : 0.3, random);
        });
        world.run_to(30s);
        comparisons += world.guard->num_comparisons();
    }
    CAPTURE(tried.count(), comparisons);
    CHECK(comparisons >= 40);
    CHECK(tried / comparisons < 830ms);  // 920 in two windows of half a second
}

TEST_CASE("Guard returns to scheduling though a switch makes frames late", "[sched][guard]") {
    Durations took;
    for (std::uint64_t seed = 1; seed <= 41; ++seed) {
        GuardMode mode = GuardMode::kEnforce;
        nanoseconds switched{-1s};
        World world(kChains, seed, [&](auto chain, auto& guard, auto now, auto& random) {
            if (guard.mode(chain) != mode) switched = now;
            mode = guard.mode(chain);
            if (now - switched < 300ms) return with_late(0.7, random);
            if (mode == GuardMode::kEnforce) return with_late(now < 12s ? 0.5 : 0.05, random);
            return with_late(now < 12s ? 0.0 : 0.3, random);
        });
        nanoseconds end = 12s;
        world.run_to(end);
        while (world.guard->num_fallen() > 0 && end < 600s) world.run_to(end += 100ms);
        took.add(end - 12s);
    }
    WARN("returned after " << took);
    CHECK(took.median_s() <= 25);
    CHECK(took.nine_of_ten_s() <= 200);
}

TEST_CASE("Guard never leaves enforce while all frames are in time", "[sched][guard]") {
    World world(kChains, 1, [](auto chain, auto& guard, auto, auto& random) {
        REQUIRE(guard.mode(chain) == GuardMode::kEnforce);
        return with_late(0.0, random);
    });
    for (std::size_t i = 0; i < kChains; ++i) world.guard->estimates_contradict(i, true);
    world.run_to(300s);
    CHECK(world.guard->num_comparisons() == 0);
    CHECK(world.guard->summary() == "");
}

TEST_CASE("Guard has one chain fall back alone when it alone is harmed", "[sched][guard]") {
    // What the others would be without scheduling: the same, or much later.
    const double without = GENERATE(0.0, 0.4);
    int alone = 0;
    const int runs = 20;
    for (std::uint64_t seed = 1; seed <= runs; ++seed) {
        CAPTURE(without, seed);
        World world(kChains, seed, [=](auto chain, auto& guard, auto, auto& random) {
            const bool enforced = guard.mode(chain) == GuardMode::kEnforce;
            return with_late(chain == 3 ? (enforced ? 0.7 : 0.0) : (enforced ? 0.0 : without),
                             random);
        });
        world.run_to(40s);
        bool is_so = world.guard->settled(3).mode != GuardMode::kEnforce;
        is_so = is_so && world.guard->num_fallen() == 1;
        alone += is_so;
        world.forget();
        world.run_to(100s);
        CHECK(world.late_share_of(3) < 0.2);
        CHECK(world.late_share() < 0.03);
    }
    // Where the others lose nothing, some may fall back with it.
    CAPTURE(without);
    CHECK(alone >= (without > 0 ? runs - 2 : runs * 3 / 4));
}

TEST_CASE("Guard lets a chain be late that gives way to the others in an overload",
          "[sched][guard]") {
    World world(kChains, 1, [=](auto chain, auto& guard, auto, auto& random) {
        bool all_enforced = true;
        for (std::size_t i = 0; i < kChains; ++i)
            all_enforced = all_enforced && guard.mode(i) == GuardMode::kEnforce;
        if (all_enforced) return with_late(chain == 7 ? 0.9 : 0.05, random);
        return with_late(chain == 7 ? 0.2 : 0.4, random);  // it takes the others' time
    });
    world.run_to(120s);
    CHECK(world.all_settled(GuardMode::kEnforce));
}

TEST_CASE("Guard seldom falls back by chance", "[sched][guard]") {
    const double share = GENERATE(0.05, 0.3, 0.7);
    // Frames of a bad time are late together: 0.3 s of a second and a half.
    const bool in_bursts = GENERATE(false, true);
    int fell = 0;
    std::size_t comparisons = 0;
    const int runs = 200;
    for (std::uint64_t seed = 1; seed <= runs; ++seed) {
        World world(kChains, seed, [=](auto, auto&, nanoseconds now, auto& random) {
            const std::uint64_t third = static_cast<std::uint64_t>(now / 300ms) + seed * 1000;
            const bool bad = third * 0x9e3779b97f4a7c15u >> 32 % 64 & 1;
            return with_late(in_bursts ? (bad ? std::min(1.0, 1.6 * share) : 0.4 * share) : share,
                             random);
        });
        world.run_to(60s);
        fell += world.guard->num_fallbacks() > 0;
        comparisons += world.guard->num_comparisons();
    }
    WARN("late " << share << (in_bursts ? " in bursts" : "") << ": fell back by chance in " << fell
                 << " of " << runs << " runs of 60 s, " << comparisons << " comparisons");
    CHECK(fell <= 0.025 * static_cast<double>(comparisons));
}

TEST_CASE("Guard follows a program that changes", "[sched][guard]") {
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
        CAPTURE(seed);
        // Scheduling helps, then harms, then helps again.
        World world(kChains, seed, [](auto chain, auto& guard, nanoseconds now, auto& random) {
            const bool harms = now > 60s && now < 120s;
            const bool enforced = guard.mode(chain) == GuardMode::kEnforce;
            return with_late(enforced ? (harms ? 0.6 : 0.05) : (harms ? 0.05 : 0.5), random);
        });
        world.run_to(60s);
        CHECK(world.all_settled(GuardMode::kEnforce));
        world.run_to(90s);
        world.forget();
        world.run_to(120s);
        CHECK(world.late_share() < 0.15);
        world.run_to(150s);
        world.forget();
        world.run_to(180s);
        CHECK(world.late_share() < 0.15);
    }
}

TEST_CASE("Guard leaves a way in which a chain falls ever farther behind", "[sched][guard]") {
    World world(kChains, 1, [](auto chain, auto& guard, auto, auto& random) {
        if (guard.mode(chain) == GuardMode::kEnforce && chain == 0) return 8.0;
        return with_late(0, random);
    });
    world.run_to(60s);
    CHECK(world.guard->settled(0).mode != GuardMode::kEnforce);
}

TEST_CASE("Guard ends a comparison without a verdict when it is paused", "[sched][guard]") {
    World world(kChains, 1, [](auto chain, auto& guard, auto, auto& random) {
        return with_late(guard.mode(chain) == GuardMode::kEnforce ? 0.5 : 0.0, random);
    });
    for (nanoseconds end = 1s; world.guard->mode(0) == GuardMode::kEnforce; end += 10ms) {
        REQUIRE(end < 10s);
        world.run_to(end);
    }
    CHECK(world.guard->is_comparing());
    CHECK(world.guard->pause());
    CHECK(world.guard->mode(0) == GuardMode::kEnforce);
    CHECK_FALSE(world.guard->is_comparing());
    CHECK_FALSE(world.guard->pause());
}

TEST_CASE("Difference that a comparison finds of a chain is mostly within its interval",
          "[sched][guard]") {
    int inside = 0, told = 0;
    for (std::uint64_t seed = 0; seed < 200; ++seed) {
        World world(kChains, seed, [](auto, auto&, auto, auto& random) {
            return with_late(0.3, random);  // no way is better
        });
        world.run_to(40s);
        for (std::size_t i = 0; i < kChains; ++i) {
            const Finding& found = world.guard->settled(i).last;
            if (found.pairs < 2) continue;
            CHECK(found.low < found.high);
            ++told;
            inside += found.low < 0 && 0 < found.high;
        }
    }
    INFO(inside << " of " << told);
    CHECK(told > 400);
    CHECK(inside > 0.9 * told);
}
