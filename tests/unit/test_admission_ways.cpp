// SPDX-License-Identifier: Apache-2.0
//
// Admission by threshold, buckets, groups, or one at a time (host/sched/admission.h).
#include <optional>
#include <string>
#include <vector>

#include "host/sched/admission.h"
#include "tests/support/catch.h"
#include "tests/support/slot_views.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
using config::Scheduler;
using model::SlotView;
using sched::nanoseconds;

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
    overdue.state.blocking = false;
    CHECK(decide_by_threshold(task(0, 50ms, 0.5), {overdue}, 5ms).admit);
}

namespace {

/// A task of the chain that is `rank`th of twelve, on six levels: two chains a bucket.
SlotView request(int rank, bool started) {
    SlotView v = task(rank, 10ms, 1.0);
    v.chain.static_rank = rank;
    v.state.started = started;
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
    overdue.state.blocking = false;  // it waits for something that is not the GPU
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
    groups.parameters.quantum = quantum;
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
    all[1].state.blocking = false;
    CHECK(whose_turn(all, 0ns, 1000us).find('0') == 0);
    CHECK(whose_turn(all, 1ms, 1000us).find('0') == 0);
}

TEST_CASE("Exclusive waits for whatever is there, and all ways admit who is alone",
          "[sched][admission]") {
    SlotView other = task(1, 50ms, 0.1);
    other.ahead.launched = 1ms;
    CHECK_FALSE(decide_for(task(0, 5ms, 0.1), {other}, with(config::Admission::kExclusive)).admit);
    using config::Admission;
    for (const auto admission : {Admission::kNone, Admission::kThreshold, Admission::kPacked,
                                 Admission::kExclusive, Admission::kBuckets, Admission::kGroups})
        CHECK(decide_for(task(0, 5ms, 1.0), {}, with(admission)).admit);
}
