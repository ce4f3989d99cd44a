// SPDX-License-Identifier: Apache-2.0
#include "host/sched/admission.h"

#include <optional>
#include <string>
#include <vector>

#include "host/sched/binding.h"
#include "tests/support/catch.h"
#include "tests/support/slot_views.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
using config::Scheduler;
using model::SlotView;
using sched::nanoseconds;

TEST_CASE("Packed admits the most urgent task whatever its size", "[sched][admission]") {
    const auto d = decide_for(task(0, 5ms, 1.0), {task(1, 6ms, 1.0), task(2, 50ms, 1.0)}, kUrgency);
    CHECK(d.admit);
    CHECK(d.rank == 0);
}

TEST_CASE("Packed holds a launch that does not fit beside more urgent ones", "[sched][admission]") {
    const auto d = decide_for(task(0, 10ms, 0.5), {task(1, 5ms, 0.6)}, kUrgency);
    CHECK_FALSE(d.admit);
    CHECK(d.rank == 1);
    CHECK(d.utilization == Approx(1.1));
}

TEST_CASE("Packed admits a launch that fits beside more urgent ones", "[sched][admission]") {
    CHECK(decide_for(task(0, 10ms, 0.45), {task(1, 5ms, 0.6)}, kUrgency)
              .admit);  // exactly pack_limit
    const auto three =
        decide_for(task(0, 30ms, 0.2), {task(1, 5ms, 0.4), task(2, 9ms, 0.4)}, kUrgency);
    CHECK(three.admit);
    CHECK(three.rank == 2);
}

TEST_CASE("Packed does not hold for a task that blocks nobody, but ranks behind it",
          "[sched][admission]") {
    SlotView waiting = task(1, 5ms, 1.0);
    waiting.blocking = false;
    const auto d = decide_for(task(0, 10ms, 1.0), {waiting}, kUrgency);
    CHECK(d.admit);
    CHECK(d.rank == 1);
    CHECK(d.num_tasks == 2);
}

TEST_CASE("Ties go to the lower task, so exactly one of two is first", "[sched][policy]") {
    const SlotView a = task(0, 7ms, 1.0), b = task(1, 7ms, 1.0);
    CHECK(decide_for(a, {b}, kUrgency).rank == 0);
    CHECK(decide_for(b, {a}, kUrgency).rank == 1);
}

TEST_CASE("Admission none admits everything and still ranks", "[sched][admission]") {
    Scheduler none = kUrgency;
    none.admission = config::Admission::kNone;
    const auto d = decide_for(task(0, 10ms, 1.0), {task(1, 5ms, 1.0)}, none);
    CHECK(d.admit);
    CHECK(d.rank == 1);
}

TEST_CASE("A demoted task goes only where nobody else wants the GPU", "[sched][admission]") {
    SlotView late = task(0, -1ms, 0.1);
    late.demoted = true;
    SlotView later = task(1, -50ms, 0.1);
    const auto beside = decide_for(late, {later}, kUrgency);
    CHECK(beside.rank == 1);
    CHECK_FALSE(beside.admit);
    CHECK(decide_for(later, {late}, kUrgency).rank == 0);
    later.blocking = false;
    CHECK(decide_for(late, {later}, kUrgency).admit);
}

namespace {

Scheduler with(config::Admission admission, config::Policy policy = config::Policy::kUrgency) {
    Scheduler s;
    s.policy = policy;
    s.admission = admission;
    return s;
}

/// A decision where who has less laxity than `urgent` is truly urgent.
sched::Decision decide_by_threshold(const SlotView& self, const std::vector<SlotView>& others,
                                    std::optional<nanoseconds> urgent) {
    std::vector<SlotView> tasks{self};
    tasks.insert(tasks.end(), others.begin(), others.end());
    sched::Snapshot snapshot{0ns, tasks};
    snapshot.urgent_laxity = urgent;
    return sched::decide(with(config::Admission::kThreshold), snapshot);
}

}  // namespace

TEST_CASE("Threshold holds a launch while another task is truly urgent", "[sched][admission]") {
    CHECK_FALSE(decide_by_threshold(task(0, 50ms, 0.5), {task(1, 3ms, 0.5)}, 5ms).admit);
    CHECK(decide_by_threshold(task(0, 50ms, 0.5), {task(1, 6ms, 0.5)}, 5ms).admit);
    CHECK(decide_by_threshold(task(0, 50ms, 0.5), {task(1, 3ms, 0.5)}, std::nullopt).admit);
}

TEST_CASE("Threshold exempts the truly urgent, the small, and late tasks are not urgent",
          "[sched][admission]") {
    CHECK(decide_by_threshold(task(0, 4ms, 0.5), {task(1, 3ms, 0.5)}, 5ms).admit);
    CHECK(decide_by_threshold(task(0, 50ms, 0.09), {task(1, 3ms, 0.5)}, 5ms).admit);
    CHECK_FALSE(decide_by_threshold(task(0, 50ms, 0.1), {task(1, 3ms, 0.5)}, 5ms).admit);
    CHECK(decide_by_threshold(task(0, 50ms, 0.5), {task(1, -3ms, 0.5)}, 5ms).admit);
    SlotView overdue = task(1, 3ms, 0.5);
    overdue.blocking = false;
    CHECK(decide_by_threshold(task(0, 50ms, 0.5), {overdue}, 5ms).admit);
}

namespace {

/// A task of the chain that is `rank`th of twelve, on six levels: two chains a bucket.
SlotView request(int rank, bool started) {
    SlotView v = task(rank, 10ms, 1.0);
    v.static_rank = rank;
    v.started = started;
    return v;
}

bool bucket_admits(const SlotView& self, const std::vector<SlotView>& others) {
    std::vector<SlotView> tasks{self};
    tasks.insert(tasks.end(), others.begin(), others.end());
    sched::Snapshot snapshot{0ns, tasks};
    snapshot.num_chains = 12;
    snapshot.num_levels = 6;
    return sched::decide(with(config::Admission::kBuckets, config::Policy::kStatic), snapshot)
        .admit;
}

}  // namespace

TEST_CASE("Buckets have one request in flight each, by static order", "[sched][admission]") {
    CHECK_FALSE(bucket_admits(request(2, false), {request(3, true)}));
    CHECK(bucket_admits(request(3, true), {request(2, false)}));         // it has begun
    CHECK_FALSE(bucket_admits(request(3, false), {request(2, false)}));  // behind it in the queue
    CHECK(bucket_admits(request(2, false), {request(3, false)}));
    CHECK(bucket_admits(request(4, false), {request(3, true), request(6, true)}));
    SlotView overdue = request(2, true);
    overdue.blocking = false;  // it waits for something that is not the GPU
    CHECK(bucket_admits(request(3, false), {overdue}));
}

TEST_CASE("The first bucket runs all of its requests at once", "[sched][admission]") {
    CHECK(bucket_admits(request(1, false), {request(0, true)}));
}

namespace {

SlotView sized(int index, double utilization) {
    SlotView v = task(index, 10ms, utilization);
    v.mean_utilization = utilization;
    return v;
}

/// @returns the indices of the tasks that may launch now
std::string whose_turn(const std::vector<SlotView>& all, nanoseconds now, nanoseconds quantum) {
    Scheduler groups = with(config::Admission::kGroups);
    groups.quantum = quantum;
    std::string who;
    for (const SlotView& self : all) {
        std::vector<SlotView> tasks{self};
        for (const SlotView& other : all)
            if (other.task != self.task) tasks.push_back(other);
        if (sched::decide(groups, {now, tasks}).admit) who += std::to_string(self.task);
    }
    return who;
}

}  // namespace

TEST_CASE("Groups of complementary utilisation take turns", "[sched][admission]") {
    // 0.8 with 0.2, 0.6 with 0.3: two groups, whose turns are a quantum.
    const std::vector all{sized(0, 0.8), sized(1, 0.3), sized(2, 0.6), sized(3, 0.2)};
    const auto at = [&](nanoseconds now) { return whose_turn(all, now, 1000us); };
    CHECK(at(0ns) == "03");
    CHECK(at(999'999ns) == "03");
    CHECK(at(1ms) == "12");
    CHECK(at(2ms) == "03");
    CHECK(whose_turn(all, 1ms, 500us) == "03");
    CHECK(whose_turn(all, 2ms, 2000us) == "12");
}

TEST_CASE("A task that needs no GPU now has no turn of its own", "[sched][admission]") {
    std::vector all{sized(0, 0.8), sized(1, 0.9)};
    CHECK(whose_turn(all, 0ns, 1000us) == "1");
    all[1].blocking = false;
    CHECK(whose_turn(all, 0ns, 1000us).find('0') == 0);
    CHECK(whose_turn(all, 1ms, 1000us).find('0') == 0);
}

TEST_CASE("Exclusive waits for whatever is there, and all ways admit who is alone",
          "[sched][admission]") {
    SlotView other = task(1, 50ms, 0.1);
    other.launched = 1ms;
    CHECK_FALSE(decide_for(task(0, 5ms, 0.1), {other}, with(config::Admission::kExclusive)).admit);
    using config::Admission;
    for (const auto admission : {Admission::kNone, Admission::kThreshold, Admission::kPacked,
                                 Admission::kExclusive, Admission::kBuckets, Admission::kGroups})
        CHECK(decide_for(task(0, 5ms, 1.0), {}, with(admission)).admit);
}

TEST_CASE("With slack in the plan more may share the GPU", "[sched][admission]") {
    const std::vector tasks{task(1, 50ms, 0.7, 200ms), task(0, 5ms, 0.8, 100ms)};
    const auto admits = [&](nanoseconds slack) {
        sched::Snapshot snapshot{0ns, tasks};
        snapshot.plan.slack = slack;
        return sched::decide(Scheduler{}, snapshot).admit;
    };
    CHECK_FALSE(admits(0ns));
    CHECK_FALSE(admits(9'999'999ns));
    CHECK(admits(10ms));
    Scheduler narrow;
    narrow.share_limit = 1.4;
    sched::Snapshot snapshot{0ns, tasks};
    snapshot.plan.slack = 500ms;
    CHECK_FALSE(sched::decide(narrow, snapshot).admit);
}

TEST_CASE("Where some are tight, who comes before them may share the GPU", "[sched][admission]") {
    std::vector tasks{task(1, 50ms, 0.7, 200ms), task(0, 5ms, 0.8, 100ms)};
    const auto admits = [&](const sched::TaskSet& may_share) {
        sched::Snapshot snapshot{0ns, tasks};
        snapshot.plan = {.may_share = may_share, .slack = 4ms};
        return sched::decide(Scheduler{}, snapshot).admit;
    };
    CHECK(admits({1}));
    CHECK_FALSE(admits({0}));  // the other one may
    tasks[1].needs_all = true;
    CHECK_FALSE(admits({1}));
}

TEST_CASE("Slack lets nobody add to what somebody waits for to drain", "[sched][admission]") {
    std::vector tasks{task(1, 50ms, 0.7, 200ms), task(0, 5ms, 0.8, 100ms)};
    sched::Snapshot snapshot{0ns, tasks};
    snapshot.plan.slack = 500ms;
    CHECK(sched::decide(Scheduler{}, snapshot).admit);
    tasks[1].needs_all = true;
    CHECK_FALSE(sched::decide(Scheduler{}, snapshot).admit);
}

TEST_CASE("Slack lets no demoted task in, and never less share than without it",
          "[sched][admission]") {
    std::vector tasks{task(1, 50ms, 0.5, 200ms), task(0, 5ms, 0.5, 100ms)};
    sched::Snapshot snapshot{0ns, tasks};
    Scheduler narrow;
    narrow.share_limit = 0.6;
    snapshot.plan.slack = 500ms;
    CHECK(sched::decide(narrow, snapshot).admit);  // pack_limit holds
    tasks[0].demoted = true;
    CHECK_FALSE(sched::decide(narrow, snapshot).admit);
}

TEST_CASE("Who has starved comes before everybody, the one that is late the longest first",
          "[sched][admission]") {
    const auto policy = GENERATE(config::Policy::kFeasible, config::Policy::kUrgency,
                                 config::Policy::kEdf, config::Policy::kSjf, config::Policy::kHrrn,
                                 config::Policy::kStatic, config::Policy::kFifo);
    Scheduler scheduler;
    scheduler.policy = policy;
    SlotView starved = task(1, -300ms, 0.5, -250ms), longer = task(2, -400ms, 0.5, -350ms);
    starved.starved = longer.starved = true;
    const SlotView in_time = task(0, 1ms, 1.0, 2ms);
    CHECK(decide_for(in_time, {starved, longer}, scheduler).rank == 2);
    CHECK_FALSE(decide_for(in_time, {starved, longer}, scheduler).admit);
    CHECK(decide_for(starved, {in_time, longer}, scheduler).rank == 1);
    CHECK(decide_for(longer, {in_time, starved}, scheduler).rank == 0);
    starved.demoted = true;  // as its config says
    CHECK(decide_for(starved, {in_time}, scheduler).rank == 1);
}

TEST_CASE("Passed over is overdue work of those that come before, and of no others",
          "[sched][admission]") {
    const auto overdue = [](SlotView v) {
        v.overdue = true;
        v.blocking = false;
        return v;
    };
    SlotView cleared = overdue(task(5, 3ms, 1.0));
    cleared.blocking = true;  // is being waited for
    const std::vector<SlotView> tasks{task(0, 10ms, 1.0),          overdue(task(1, 5ms, 1.0)),
                                      overdue(task(2, 20ms, 1.0)), task(3, 1ms, 1.0),
                                      overdue(task(63, 9ms, 1.0)), cleared};
    CHECK(sched::passed_over(kUrgency, {0ns, tasks}) == sched::TaskSet{1, 63});
}

namespace {

/// A task that the GPU works for in a quarter of its time alone.
SlotView launch_bound(int index, nanoseconds laxity, double utilization) {
    SlotView v = task(index, laxity, utilization);
    v.remaining_gpu = 5ms;
    v.remaining_idle = 15ms;
    return v;
}

}  // namespace

TEST_CASE("The room that a launch-bound task leaves is used", "[sched][admission]") {
    const SlotView eager = launch_bound(1, 5ms, 1.0);
    CHECK(decide_for(launch_bound(0, 10ms, 1.0), {eager}, kUrgency).admit);
    CHECK(decide_for(task(0, 10ms, 0.7), {eager}, kUrgency).admit);
    CHECK_FALSE(decide_for(task(0, 10ms, 1.0), {eager}, kUrgency).admit);
    const SlotView three[] = {launch_bound(1, 5ms, 1.0), launch_bound(2, 6ms, 1.0),
                              launch_bound(3, 7ms, 1.0)};
    CHECK(decide_for(launch_bound(0, 10ms, 1.0), {three[0], three[1], three[2]}, kUrgency).admit);
    SlotView busier = task(4, 4ms, 0.5);
    CHECK_FALSE(
        decide_for(launch_bound(0, 10ms, 1.0), {three[0], three[1], busier}, kUrgency).admit);
}

TEST_CASE("A launch-bound task that has much on the GPU leaves no room", "[sched][admission]") {
    SlotView eager = launch_bound(1, 5ms, 1.0);
    eager.launched = 2ms;
    CHECK_FALSE(decide_for(launch_bound(0, 10ms, 1.0), {eager}, kUrgency).admit);
    // Nor does a launch that takes long by itself fit into it.
    SlotView large = launch_bound(0, 10ms, 1.0);
    large.next = 2ms;
    CHECK_FALSE(decide_for(large, {launch_bound(1, 5ms, 1.0)}, kUrgency).admit);
}

TEST_CASE("Who is late holds nobody up, unless it has waited for too long", "[sched][admission]") {
    SlotView late = task(1, -1ms, 1.0, 10ms);
    const SlotView later = task(0, -5ms, 1.0, 20ms);
    CHECK(decide_for(later, {late}, kUrgency).admit);
    CHECK_FALSE(decide_for(later, {late, task(2, 5ms, 1.0)}, kUrgency).admit);
    late.starved = true;
    CHECK_FALSE(decide_for(later, {late}, kUrgency).admit);
}

namespace {

/// Small, and slowed by others that launch.
SlotView slowed(int index, nanoseconds laxity) {
    SlotView v = launch_bound(index, laxity, 0.1);
    v.launching = model::Launching::kSlowed;
    v.launches = true;
    return v;
}

}  // namespace

TEST_CASE("Of those that slow each other's launching, two launch at a time",
          "[sched][admission][launching]") {
    const SlotView first = slowed(1, 5ms), second = slowed(2, 6ms), third = slowed(3, 50ms);
    CHECK(decide_for(slowed(0, 10ms), {first, third}, kUrgency).admit);
    const auto d = decide_for(slowed(0, 10ms), {first, second}, kUrgency);
    CHECK_FALSE(d.admit);
    CHECK(d.launches_late);
    CHECK(d.rank == 2);

    Scheduler scheduler = kUrgency;
    scheduler.launchers = 1;
    CHECK_FALSE(decide_for(slowed(0, 10ms), {first, third}, scheduler).admit);
    scheduler.launchers = 0;
    CHECK(decide_for(slowed(0, 10ms), {first, second}, scheduler).admit);
    scheduler = kUrgency;
    scheduler.admission = config::Admission::kNone;
    CHECK(decide_for(slowed(0, 10ms), {first, second}, scheduler).admit);
}

TEST_CASE("Whose launching nobody slows, or who slows nobody's, is not waited for",
          "[sched][admission][launching]") {
    const SlotView first = slowed(1, 5ms), second = slowed(2, 6ms);
    CHECK(decide_for(launch_bound(0, 10ms, 0.1), {first, second}, kUrgency).admit);

    SlotView free = first, done = first, unknown = first;
    free.launching = model::Launching::kFree;
    done.launches = false;  // all is launched: it waits for the GPU
    unknown.launching = model::Launching::kUnknown;
    CHECK(decide_for(slowed(0, 10ms), {free, second}, kUrgency).admit);
    CHECK(decide_for(slowed(0, 10ms), {done, second}, kUrgency).admit);
    CHECK_FALSE(decide_for(slowed(0, 10ms), {unknown, second}, kUrgency).admit);
}

TEST_CASE("It is told that a launch may go only as those before it pause",
          "[sched][admission][launching]") {
    const SlotView first = slowed(1, 5ms), second = slowed(2, 6ms);
    SlotView paused = second, behind = slowed(2, 50ms);
    paused.launches = behind.launches = false;
    paused.pauses = behind.pauses = true;
    const auto pause = [&](const std::vector<SlotView>& others) {
        return decide_for(slowed(0, 10ms), others, kUrgency).others_pause;
    };
    CHECK(pause({first, paused}));
    CHECK_FALSE(pause({first, second}));  // it may not go
    CHECK_FALSE(pause({first, behind}));
    CHECK_FALSE(pause({paused}));  // there was room for it
    paused.launching = model::Launching::kFree;
    CHECK_FALSE(pause({first, paused}));
}

TEST_CASE("Other admissions know nothing of launching in turn", "[sched][admission][launching]") {
    const std::vector<SlotView> two{slowed(1, 5ms), slowed(2, 6ms)};
    Scheduler scheduler = kUrgency;
    scheduler.admission = config::Admission::kThreshold;
    CHECK_FALSE(decide_for(slowed(0, 10ms), two, scheduler).launches_late);
    scheduler.admission = config::Admission::kExclusive;
    CHECK_FALSE(decide_for(slowed(0, 10ms), {two[0]}, scheduler).launches_late);
}

TEST_CASE("Late ones launch in turn, too", "[sched][admission][launching]") {
    const SlotView first = slowed(1, -5ms), second = slowed(2, -4ms);
    CHECK_FALSE(decide_for(slowed(0, -3ms), {first, second}, kUrgency).admit);
}
