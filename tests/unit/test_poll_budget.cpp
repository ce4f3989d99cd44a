// SPDX-License-Identifier: Apache-2.0
//
// How long held launches sleep between looks, in virtual time: many threads that take turns.
#include "host/sched/poll_budget.h"

#include <algorithm>
#include <vector>

#include "tests/support/catch.h"

using namespace std::chrono_literals;
using std::chrono::nanoseconds;
using urgengo::sched::PollBudget;

namespace {

constexpr nanoseconds kPoll = 50us;
constexpr nanoseconds kFar = 1s;     // to the end of a hold
constexpr nanoseconds kLate = 29us;  // a sleep takes so much longer (host/base/clock.h)

/// So many threads are held, of ranks 0, 1, 2...; each look takes `look`.
struct Held {
    Held(int num_threads, nanoseconds its_look) : look(its_look) {
        for (int i = 0; i < num_threads; ++i) due.push_back(now + i * 1us);
    }
    /// @returns looks in this time
    int run(nanoseconds time) {
        int looks = 0;
        for (const nanoseconds end = now + time; now < end;) {
            const auto next = std::min_element(due.begin(), due.end());
            now = std::max(now, *next);
            budget.looked(now, now + look);
            *next = now + look + kLate + budget.rest(static_cast<int>(next - due.begin()), kFar);
            ++looks;
        }
        return looks;
    }
    double share_of(int looks, nanoseconds time) const {
        return static_cast<double>(looks) *
               static_cast<double>((look + PollBudget::kWakeUp).count()) /
               static_cast<double>(time.count());
    }

    PollBudget budget{kPoll};
    nanoseconds look, now{1s};
    std::vector<nanoseconds> due;
};

}  // namespace

TEST_CASE("The first few look often, whoever has more before it sleeps for longer",
          "[sched][poll]") {
    const PollBudget budget(kPoll);
    CHECK(budget.rest(0, kFar) == kPoll);
    CHECK(budget.rest(2, kFar) == kPoll);
    nanoseconds last = kPoll;
    for (int rank = 3; rank < 40; ++rank) {
        CHECK(budget.rest(rank, kFar) > last);
        last = budget.rest(rank, kFar);
    }
    CHECK(budget.rest(255, kFar) == 2ms);
    CHECK(budget.rest_paced(kFar) == kPoll);
}

TEST_CASE("A launch that waits for its turn at launching looks seldom", "[sched][poll]") {
    const PollBudget budget(kPoll);
    CHECK(budget.rest_for_turn(0, kFar) == 500us);
    CHECK(budget.rest_for_turn(5, kFar) == 500us);
    CHECK(budget.rest_for_turn(21, kFar) == budget.rest(21, kFar));
    CHECK(budget.rest_for_turn(0, 300us) == 300us);
    CHECK(budget.rest_for_turn(0, 0us) == budget.rest(0, 0us));
    CHECK(PollBudget(10ms).rest_for_turn(0, kFar) == 10ms);
}

TEST_CASE("Nobody sleeps past the end of its own hold", "[sched][poll]") {
    const PollBudget budget(kPoll);
    CHECK(budget.rest(200, 300us) == 300us);
    CHECK(budget.rest(0, 20us) == 20us);
    CHECK(budget.rest(200, 0us) > 0us);
}

TEST_CASE("An interval that the config makes longer is kept", "[sched][poll]") {
    const PollBudget budget(10ms);
    CHECK(budget.rest(0, kFar) == 10ms);
    CHECK(budget.rest(200, kFar) == 10ms);
}

TEST_CASE("A few that are held look as if there were no budget", "[sched][poll]") {
    Held held(3, 1us);
    held.run(1s);
    CHECK(held.budget.rest(0, kFar) == kPoll);
    CHECK(held.budget.num_ends() == 0);
}

TEST_CASE("Looks of many that are held take a fifth of a core", "[sched][poll]") {
    for (const int num_threads : {10, 25}) {
        INFO(num_threads << " threads");
        Held held(num_threads, 1us);
        held.run(2s);  // finds its pace
        const double share = held.share_of(held.run(1s), 1s);
        CHECK(share < 1.15 * PollBudget::kShare);
        CHECK(share > 0.5 * PollBudget::kShare);
        CHECK(held.budget.rest(0, kFar) <= held.budget.rest(5, kFar));
        CHECK(held.budget.num_ends() == 0);
    }
}

TEST_CASE("Nobody sleeps for much longer than those before it may need", "[sched][poll]") {
    Held held(100, 10us);
    held.run(1s);
    CHECK(held.budget.rest(0, kFar) <= 4 * kPoll);
    CHECK(held.budget.rest(3, kFar) <= 2 * 5 * kPoll);
    CHECK(held.budget.rest(99, kFar) == 2ms);
}

TEST_CASE("Holds end when even the longest intervals take too much, and come back",
          "[sched][poll]") {
    Held held(250, 20us);  // 250 x 500 looks a second, 24 us each: three cores
    held.run(700ms);
    REQUIRE(held.budget.num_ends() == 1);
    CHECK(held.budget.is_over(held.now));
    CHECK_FALSE(held.budget.is_over(held.now + 1s));
}

TEST_CASE("After a time without looks the intervals are as short as at first", "[sched][poll]") {
    Held held(100, 10us);
    held.run(500ms);
    REQUIRE(held.budget.rest(5, kFar) > 4 * kPoll);
    held.now += 1s;
    held.budget.looked(held.now, held.now + 10us);
    CHECK(held.budget.rest(5, kFar) == 4 * kPoll);
}

TEST_CASE("What looks take is summed up, window by window", "[sched][poll]") {
    Held held(3, 2us);
    CHECK(held.budget.total() == 0ns);
    const int looks = held.run(2s);
    const nanoseconds all = looks * (held.look + PollBudget::kWakeUp);
    CHECK(held.budget.total() <= all);
    CHECK(held.budget.total() > all * 9 / 10);  // but for the window at hand
}
