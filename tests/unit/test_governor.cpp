// SPDX-License-Identifier: Apache-2.0
#include "host/sched/governor.h"

#include <random>

#include "tests/support/catch.h"
#include "tests/support/governor_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using config::Admission;
using config::Policy;
using sched::Answer;
using sched::Why;

namespace {

config::Scheduler scheduler_with(Policy policy, Admission admission = Admission::kPacked,
                                 int launchers = 2) {
    config::Scheduler scheduler;
    scheduler.policy = policy;
    scheduler.admission = admission;
    scheduler.packing.launchers = launchers;
    return scheduler;
}

}  // namespace

TEST_CASE("A task alone on the GPU goes as before until its run-ahead is used up",
          "[sched][governor]") {
    GovernorFixture f({100ms, 50ms});
    f.begin(0, 20ms);
    CHECK(f.governor.goes_as_before(f.task(0), f.now));
    for (int i = 0; i < 3; ++i) f.launch(0, 500us);
    CHECK_FALSE(f.governor.goes_as_before(f.task(0), f.now));

    const Answer waits = f.ask(0);
    REQUIRE(waits.wait);
    CHECK(waits.wait->why == Why::kRunAhead);
    CHECK(waits.wait->behind == -1);
    CHECK(waits.wait->is_paced);
    CHECK(waits.wait->has_work);
    CHECK_FALSE(waits.wait->wants_mark);  // one is under way
    CHECK(waits.wait->sleep == 50us);

    f.execute(0);
    CHECK_FALSE(f.ask(0).wait);
    CHECK(f.num_progressed == 1);
}

TEST_CASE("A task is not paced for what no mark can show", "[sched][governor]") {
    GovernorFixture f({100ms});
    f.begin(0, 20ms);
    for (int i = 0; i < 3; ++i) f.launch(0, 500us);
    CHECK_FALSE(f.ask(0, 100us, {.is_seen = false}).wait);
    CHECK(f.ask(0).wait);
}

TEST_CASE("A less urgent launch waits behind the first of those that fill the GPU",
          "[sched][governor]") {
    GovernorFixture f({300ms, 50ms, 40ms}, scheduler_with(Policy::kEdf));
    for (int i : {0, 1, 2}) f.begin(i, 20ms);
    f.launch(1, 500us);
    f.launch(2, 500us);

    const Answer held = f.ask(0);
    REQUIRE(held.wait);
    CHECK(held.wait->why == Why::kRank);
    CHECK(held.wait->behind == 2);
    CHECK_FALSE(held.wait->is_paced);
    CHECK(held.decision.rank == 2);

    const Answer first = f.ask(2);
    CHECK_FALSE(first.wait);
    CHECK(first.decision.rank == 0);
    // A chain that the guard gives priorities alone is not held, and keeps its rank.
    const Answer let_go = f.ask(0, 100us, {.enforces = false});
    CHECK_FALSE(let_go.wait);
    CHECK(let_go.decision.rank == 2);
}

TEST_CASE("A wait says why, by the way to admit", "[sched][governor]") {
    const auto answer_of = [](const config::Scheduler& scheduler, auto&& prepare) {
        GovernorFixture f({300ms, 50ms}, scheduler);
        for (int i : {0, 1}) f.begin(i, 20ms);
        f.launch(1, 500us);
        prepare(f);
        const Answer answer = f.ask(0);
        REQUIRE(answer.wait);
        CHECK(answer.wait->behind == 1);
        return answer.wait->why;
    };
    const auto nothing = [](GovernorFixture&) {};
    CHECK(answer_of(scheduler_with(Policy::kEdf), nothing) == Why::kRank);
    CHECK(answer_of(scheduler_with(Policy::kEdf, Admission::kExclusive), nothing) ==
          Why::kExclusive);
    CHECK(answer_of(scheduler_with(Policy::kEdf), [](GovernorFixture& f) {
              f.slot(1).state = abi::TaskState::kSync;
              f.slot(1).sync_until_ns = (f.now + 5ms).count();
          }) == Why::kDrain);
    CHECK(answer_of(scheduler_with(Policy::kEdf, Admission::kPacked, 1), [](GovernorFixture& f) {
              f.slot(0).launching = model::Launching::kSlowed;
          }) == Why::kTurnToLaunch);
    CHECK(answer_of(scheduler_with(Policy::kStatic, Admission::kBuckets), [](GovernorFixture& f) {
              for (int i : {0, 1}) f.task(i).run.priority.greatest = 0;
              f.slot(0).static_rank = 1;
              f.slot(1).static_rank = 1;
              for (int i : {0, 1}) f.task(i).run.priority.greatest = -1;
          }) == Why::kBucket);
}

TEST_CASE("What is decided by a plan that took long stands as long as that plan",
          "[sched][governor]") {
    GovernorFixture f({50ms, 300ms, 300ms});
    for (int i : {0, 1}) f.begin(i, 5ms);
    REQUIRE(f.ask(0).has_made_plan);
    f.governor.plan().took(100us);  // it stands for 0.5 ms
    f.begin(2, 5ms);

    f.now += 100us;
    CHECK_FALSE(f.governor.decision_stands(f.task(0), f.now));  // somebody has come
    CHECK_FALSE(f.ask(0).has_made_plan);
    CHECK(f.governor.decision_stands(f.task(0), f.now));
    f.now += 300us;
    CHECK(f.governor.decision_stands(f.task(0), f.now));
    f.now += 100us;
    CHECK_FALSE(f.governor.decision_stands(f.task(0), f.now));
    CHECK(f.ask(0).has_made_plan);
    CHECK(f.governor.decision_stands(f.task(0), f.now));
}

TEST_CASE("A plan is made anew when an instance that was in time is late", "[sched][governor]") {
    GovernorFixture f({5ms, 300ms});
    f.begin(0, 4900us);  // 0.1 ms to spare
    f.launch(0, 500us);
    f.begin(1, 5ms);
    REQUIRE(f.ask(1).has_made_plan);
    f.now += 90us;
    CHECK_FALSE(f.ask(1).has_made_plan);
    CHECK(f.ask(1).decision.rank == 1);
    f.now += 11us;
    CHECK(f.ask(1).decision.rank == 1);  // it still goes first, as there is room
}

TEST_CASE("A hold ends when looking takes too much", "[sched][governor]") {
    GovernorFixture f({1s, 900ms}, scheduler_with(Policy::kEdf));
    for (int i : {0, 1}) f.begin(i, 20ms);
    f.launch(1, 500us);
    Answer answer = f.ask(0);
    for (int looks = 0; answer.wait && looks < 40'000; ++looks) {
        f.execute(1);
        f.launch(1, 500us);
        f.slot(1).head_remaining_ns = nanoseconds(20ms).count();  // it stays at its work
        f.sleep(0, *answer.wait);
        answer = f.ask(0);
        f.governor.looked(f.task(0), answer, f.now, f.now + 1ms);
    }
    CHECK_FALSE(answer.wait);
    CHECK(f.governor.polls().num_ends() == 1);
    CHECK(f.task(0).run.waited.held < 900ms);
}

TEST_CASE("An arriving task that is less urgent is launched one level below a lead",
          "[sched][governor]") {
    GovernorFixture f({50ms, 300ms}, scheduler_with(Policy::kEdf));
    f.now += 10s;  // nobody else for long
    f.begin(0, 20ms);
    CHECK(f.governor.ahead().lead.leads(f.task(0), f.now));
    CHECK(f.governor.levels(f.task(0), true, {}, f.now).level == 3);
    f.launch(0, 3ms);

    f.begin(1, 20ms);
    sched::Decision second;
    second.rank = 1;
    second.before.insert(0);
    CHECK(f.governor.levels(f.task(1), true, second, f.now).level == 4);
    f.governor.leaves_gpu(f.task(0), f.now);
    CHECK(f.governor.levels(f.task(1), true, second, f.now).level == 1);
}

namespace {

/// Tasks that fork, each further ahead than it is paced for.
struct Forks {
    GovernorFixture f;

    explicit Forks(std::size_t tasks)
        : f(std::vector<nanoseconds>(tasks, 100ms), scheduler_with(Policy::kEdf)) {
        for (int i = 0; i < static_cast<int>(tasks); ++i) f.begin(i, 20ms);
    }
    /// @param before  those that are more urgent
    int level(int index, std::initializer_list<int> before, bool forks = true) {
        sched::GovernedTask& task = f.task(index);
        sched::Decision decision;
        for (const int other : before) decision.before.insert(other);
        decision.rank = static_cast<int>(before.size());
        if (forks) task.work.launched = task.work.marked + 5ms;
        return f.governor.levels(task, !forks, decision, f.now).level;
    }
};

}  // namespace

TEST_CASE("A task between two forks is launched between them", "[sched][governor][lead]") {
    const bool forks = GENERATE(true, false);
    Forks f(4);
    SECTION("Whichever comes first") {
        CHECK(f.level(0, {}) == 3);
        CHECK(f.level(1, {0}) == 5);
        CHECK(f.level(2, {0}, forks) == 4);
        CHECK(f.level(1, {0, 2}) == 5);
        CHECK(f.level(0, {}) == 3);
    }
    SECTION("Or last") {
        CHECK(f.level(0, {}) == 3);
        CHECK(f.level(1, {}) == 1);
        CHECK(f.level(2, {1}, forks) == 2);
        CHECK(f.level(3, {}, false) == 0);
    }
}

TEST_CASE("A launch of no fork is above the forks of less urgent tasks",
          "[sched][governor][lead]") {
    Forks f(5);
    CHECK(f.level(0, {}) == 3);
    CHECK(f.level(1, {}) == 1);
    CHECK(f.level(2, {}, false) == 0);
    CHECK(f.level(3, {2}, false) == 0);
    CHECK(f.level(4, {1, 2, 3}, false) == 2);
}

TEST_CASE("Who is only paced goes as far as a lead while a more urgent frame is awaited",
          "[sched][governor]") {
    GovernorFixture f({100ms, 20ms, 30ms}, scheduler_with(Policy::kEdf));
    f.begin(2, 1ms);  // somebody is there: nobody leads
    f.frames_come(1);
    f.governor.leaves_gpu(f.task(2), f.now);
    f.page->active[0] = 0;
    f.now += 20ms;
    f.begin(0, 60ms);
    for (int i = 0; i < 20; ++i) f.launch(0, 500us);
    CHECK(f.ask(0).wait);  // it may come any time
    f.now += 5ms;
    f.execute(0);
    CHECK_FALSE(f.ask(0).wait);
    for (int i = 0; i < 8; ++i) f.launch(0, 500us);
    const Answer lent = f.ask(0);
    CHECK_FALSE(lent.wait);
    CHECK(lent.loan == sched::Loan::kToFirst);
    for (int i = 0; i < 12; ++i) f.launch(0, 500us);
    const Answer waits = f.ask(0);
    REQUIRE(waits.wait);
    CHECK(waits.wait->is_paced);
    CHECK(waits.loan == sched::Loan::kNone);
}

TEST_CASE("A loan that is refused is not in vain", "[sched][governor]") {
    GovernorFixture f({100ms, 20ms}, scheduler_with(Policy::kEdf));
    sched::Expectation& urgent = f.task(1).chain->expectation;
    f.frames_come(1);
    f.now += 20ms;
    f.begin(0, 60ms);
    for (int i = 0; i < 20; ++i) f.launch(0, 500us);
    f.now += 4ms;
    f.execute(0);
    CHECK_FALSE(f.ask(0).wait);
    for (int i = 0; i < 20; ++i) f.launch(0, 500us);
    CHECK(f.ask(0).wait);  // farther ahead than a lead
    f.now += 6ms;          // by which a loan would have been in vain
    urgent.arrived(f.now, 20ms);
    urgent.launched(f.now, f.now);
    CHECK(urgent.awaited(20ms, 20ms, 0ms));  // and this frame lent nothing
}

TEST_CASE("A copy waits for those of more urgent tasks alone", "[sched][governor]") {
    GovernorFixture f({300ms, 50ms}, scheduler_with(Policy::kEdf));
    for (int i : {0, 1}) f.begin(i, 20ms);
    std::array<bool, abi::kMaxTasks> at_engine{};
    Answer answer;
    CHECK_FALSE(f.governor.copy_waits(f.task(0), at_engine, answer, f.now));
    at_engine[1] = true;
    CHECK(f.governor.copy_waits(f.task(0), at_engine, answer, f.now));
    at_engine = {};
    at_engine[0] = true;
    CHECK_FALSE(f.governor.copy_waits(f.task(1), at_engine, answer, f.now));
}

namespace {

constexpr Admission kAdmissions[] = {Admission::kPacked,    Admission::kBuckets,
                                     Admission::kGroups,    Admission::kExclusive,
                                     Admission::kThreshold, Admission::kNone};
constexpr Policy kPolicies[] = {Policy::kFeasible, Policy::kUrgency, Policy::kEdf, Policy::kSjf,
                                Policy::kHrrn,     Policy::kStatic,  Policy::kFifo};

class Spoiler {
  public:
    explicit Spoiler(unsigned seed) : engine_(seed) {}
    bool one_in(int n) { return std::uniform_int_distribution(1, n)(engine_) == 1; }
    std::int64_t ns(std::int64_t least, std::int64_t most) {
        return std::uniform_int_distribution<std::int64_t>(least, most)(engine_);
    }
    /// Whatever a slot may say, and what no slot should.
    void spoil(GovernorFixture& f, int index) {
        abi::TaskSlot& s = f.slot(index);
        const std::int64_t now_ns = f.now.count();
        if (one_in(2)) s.deadline_ns = now_ns + ns(-400'000'000, 400'000'000);
        if (one_in(2)) s.head_remaining_ns = ns(-1'000'000, 100'000'000);
        if (one_in(2)) s.launched_ns = ns(0, 1'000'000'000'000);
        if (one_in(2)) s.launch_ns = now_ns - ns(-1'000'000, 2'000'000);
        if (one_in(2)) s.head_utilization_ppm = static_cast<std::uint32_t>(ns(0, 4'000'000'000));
        if (one_in(3)) s.state = static_cast<abi::TaskState>(ns(0, 4));
        if (one_in(3)) s.launching = static_cast<model::Launching>(ns(0, 2));
        if (one_in(3)) s.sync_until_ns = now_ns + ns(-10'000'000, 10'000'000'000);
        if (one_in(4)) s.demotes = static_cast<std::uint16_t>(ns(0, 1));
        if (one_in(4)) s.criticality = static_cast<std::uint16_t>(ns(0, 60'000));
        if (one_in(8)) s.marks_issued = static_cast<std::uint32_t>(ns(0, 4'000'000'000));
        if (one_in(8)) s.version.fetch_add(1);
    }

  private:
    std::mt19937_64 engine_;
};

}  // namespace

TEST_CASE("A hold ends within its bound, whatever the page says", "[sched][governor][property]") {
    for (unsigned seed = 1; seed <= 60; ++seed) {
        INFO("seed " << seed);
        Spoiler random(seed);
        config::Scheduler scheduler;
        scheduler.admission = kAdmissions[seed % std::size(kAdmissions)];
        scheduler.policy = kPolicies[seed % std::size(kPolicies)];
        std::vector<nanoseconds> deadlines{20ms};
        while (deadlines.size() < 2 + seed % 7)
            deadlines.push_back(nanoseconds(random.ns(5'000'000, 100'000'000)));
        GovernorFixture f(deadlines, scheduler);
        for (int i = 0; i < static_cast<int>(deadlines.size()); ++i) f.begin(i, 500ms);
        for (int i = 0; i < 4; ++i) f.launch(0, 2ms);

        const nanoseconds bound = f.governor.hold_bound(f.task(0));
        const nanoseconds begin = f.now;
        CHECK(bound == 40ms);
        Answer answer = f.ask(0);
        // Held and paced, each a poll at least, for no longer than the bound.
        for (int looks = 0; answer.wait && looks < 2 * 40'000 / 50 + 2; ++looks) {
            for (int i = 1; i < static_cast<int>(deadlines.size()); ++i)
                if (random.one_in(3)) random.spoil(f, i);
            if (random.one_in(8)) random.spoil(f, 0);
            f.sleep(0, *answer.wait);
            answer = f.ask(0);
            f.governor.looked(f.task(0), answer, f.now, f.now + 1us);
        }
        CHECK_FALSE(answer.wait);
        CHECK(f.task(0).run.waited.held <= bound);
        CHECK(f.task(0).run.waited.paced <= bound);
        CHECK(f.now - begin <= 2 * bound);
    }
}
