// SPDX-License-Identifier: Apache-2.0
//
// The guard beside a program whose frames are late together, now and then
// (tests/support/guard_world.h).
#include <algorithm>
#include <cmath>

#include "host/sched/guard.h"
#include "tests/support/catch.h"
#include "tests/support/guard_world.h"

using namespace urgengo::sched;
using namespace urgengo::testing;
using namespace std::chrono_literals;

namespace {

constexpr std::size_t kChains = 8;

/// @returns a number from 0 to 1 that is the seed's n-th
double chance(std::uint64_t seed, std::uint64_t n) {
    std::uint64_t x = (seed << 32 | n) * 0x9e3779b97f4a7c15U;
    x = (x ^ x >> 32) * 0xd6e8feb86659fd93U;
    return static_cast<double>((x ^ x >> 32) >> 11) / 9007199254740992.0;
}

/// A machine that stalls now and then: for some 20 ms every 0.6 s.
/// @param times  so much longer the program takes to catch up
/// @returns whether frames are late now
bool catches_up(std::uint64_t seed, nanoseconds now, double times) {
    const auto nth = 2 * static_cast<std::uint64_t>(now / 600ms);
    const double begin_ms = 300 * chance(seed, nth);
    const double took_ms = -20 * std::log(chance(seed, nth + 1) + 1e-9);
    const double now_ms = 1e-6 * static_cast<double>((now % 600ms).count());
    return now_ms >= begin_ms && now_ms < begin_ms + times * took_ms;
}

}  // namespace

TEST_CASE("Guard finds harm where frames of all chains are late together, now and then",
          "[sched][guard]") {
    Durations took;
    double late = 0;
    for (std::uint64_t seed = 1; seed <= 41; ++seed) {
        World world(
            kChains, seed,
            [=](auto chain, auto& guard, auto now, auto& random) {
                const bool enforced = guard.mode(chain) == GuardMode::kEnforce;
                return with_late(catches_up(seed, now, enforced ? 4 : 1), random);
            },
            10ms, 4ms);
        nanoseconds end = 2s;
        while (world.guard->num_fallen() == 0 && end < 600s) world.run_to(end += 100ms);
        took.add(end - 1s);
        world.run_to(600s);
        late += world.late_share() / 41;
    }
    WARN("fell back after " << took << "; late in 10 minutes: " << late);
    CHECK(took.median_s() <= 45);
    CHECK(took.nine_of_ten_s() <= 90);
    CHECK(late < 0.04);
}

TEST_CASE("Guard hardly explores where scheduling helps after stalls", "[sched][guard]") {
    // Without scheduling the program takes four times as long to catch up; or every frame takes
    // eight deadlines, so that few of them end in a window.
    const bool piles_up = GENERATE(false, true);
    const int runs = 20;
    int fell = 0;
    nanoseconds otherwise{0}, longest{0};
    for (std::uint64_t seed = 1; seed <= runs; ++seed) {
        nanoseconds since{-1};
        World world(
            kChains, seed,
            [&](auto chain, auto& guard, auto now, auto& random) {
                const bool enforced = guard.mode(chain) == GuardMode::kEnforce;
                if (!enforced && since.count() < 0) since = now;
                if (enforced && since.count() >= 0) {
                    otherwise += now - since;
                    longest = std::max(longest, now - since);
                    since = nanoseconds{-1};
                }
                if (!enforced && piles_up) return 8.0;
                return with_late(catches_up(seed, now, enforced ? 1 : 4), random);
            },
            10ms, 4ms);
        world.run_to(600s);
        fell += world.guard->num_fallen() > 0;
    }
    const auto to_s = [](nanoseconds time) { return 1e-9 * static_cast<double>(time.count()); };
    WARN((piles_up ? "piles up: " : "after stalls: ")
         << to_s(otherwise) / runs << " s of 10 minutes spent otherwise, " << to_s(longest)
         << " s in a row at most; fell back in " << fell << " of " << runs << " runs");
    CHECK(fell == 0);
    CHECK(to_s(otherwise) / runs < (piles_up ? 1 : 5));
    CHECK(to_s(longest) < (piles_up ? 1 : 4.1));  // two windows
}
