// SPDX-License-Identifier: Apache-2.0
//
// What the guard compares where a bystander keeps the GPU busy, or no launch is held.
#include "host/sched/guard.h"

#include "tests/support/catch.h"
#include "tests/support/guard_world.h"

using namespace urgengo::sched;
using namespace urgengo::testing;
using namespace std::chrono_literals;

namespace {

constexpr std::size_t kChains = 8;

}  // namespace

TEST_CASE("Guard never does nothing beside a busy bystander", "[sched][guard]") {
    const bool beside = GENERATE(false, true);
    // All are late, whatever the mode; or one chain is.
    const bool all_are_late = GENERATE(true, false);
    bool observed = false;
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
        World world(kChains, seed, [&](auto chain, auto& guard, auto, auto& random) {
            observed = observed || guard.mode(chain) == GuardMode::kObserve;
            return with_late(all_are_late || chain == 2 ? 0.5 : 0.0, random);
        });
        world.guard->bystanders_are_busy(beside);
        world.run_to(60s);
        CHECK(world.guard->num_comparisons() > 0);
    }
    CHECK(observed != beside);
}

TEST_CASE("Guard does nothing no more once a bystander is busy", "[sched][guard]") {
    bool is_busy = false;
    int observed_beside = 0;
    World world(kChains, 1, [&](auto chain, auto& guard, auto, auto& random) {
        const bool observes = guard.mode(chain) == GuardMode::kObserve;
        observed_beside += is_busy && observes;
        return with_late(observes ? 0.0 : 0.5, random);
    });
    const auto turn_up = [&](bool they_are) {
        is_busy = they_are;
        return world.guard->bystanders_are_busy(they_are);
    };
    const auto run_until = [&](auto condition) {
        for (nanoseconds end = world.now; !condition(); end += 10ms) {
            REQUIRE(end < 60s);
            world.run_to(end);
        }
    };
    SECTION("in the middle of a comparison with that, which ends") {
        run_until([&] { return world.guard->mode(0) == GuardMode::kObserve; });
        REQUIRE(world.guard->is_comparing());
        CHECK(turn_up(true));
        CHECK_FALSE(world.guard->is_comparing());
        CHECK(world.guard->mode(0) == GuardMode::kEnforce);
    }
    SECTION("where that has been settled, which it is again behind it") {
        run_until([&] { return world.all_settled(GuardMode::kObserve); });
        CHECK(turn_up(true));
        CHECK_FALSE(turn_up(true));
        CHECK(world.guard->mode(0) == GuardMode::kPriorities);
        world.run_to(world.now + 100ms);
        CHECK(turn_up(false));
        CHECK(world.guard->mode(0) == GuardMode::kObserve);
    }
    SECTION("and not as long as it is") {
        run_until([&] { return world.all_settled(GuardMode::kObserve); });
        turn_up(true);
        world.run_to(world.now + 60s);
    }
    CHECK(observed_beside == 0);
}

TEST_CASE("Guard compares with doing nothing at once where nobody is held", "[sched][guard]") {
    // Priorities are no better than what is done, nothing is.
    bool observed = false;
    const auto fell_back_after_s = [&](bool nobody_is_held, bool beside, std::uint64_t seed) {
        observed = false;
        World world(kChains, seed, [&](auto chain, auto& guard, auto, auto& random) {
            const bool observes = guard.mode(chain) == GuardMode::kObserve;
            observed = observed || observes;
            return with_late(observes ? 0.1 : 0.3, random);
        });
        world.guard->nobody_is_held(nobody_is_held);
        world.guard->bystanders_are_busy(beside);
        int seconds = 1;
        while (world.guard->num_fallen() == 0 && seconds < 60) world.run_to(++seconds * 1s);
        return seconds;
    };
    int by_steps = 0, at_once = 0;
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
        by_steps += fell_back_after_s(false, false, seed);
        at_once += fell_back_after_s(true, false, seed);
        fell_back_after_s(true, true, seed);
        CHECK_FALSE(observed);
    }
    WARN("fell back after " << at_once / 10.0 << " s, by steps after " << by_steps / 10.0);
    CHECK(3 * at_once < 2 * by_steps);
}
