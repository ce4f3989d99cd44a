// SPDX-License-Identifier: Apache-2.0
#include "host/sched/admission.h"

#include <algorithm>
#include <vector>

#include "host/sched/policies/feasible.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using config::Scheduler;
using model::SlotView;
using sched::decide;
using sched::nanoseconds;

namespace {

const Scheduler kUrgency = [] {
    Scheduler s;
    s.policy = config::Policy::kUrgency;
    return s;
}();

SlotView task(int index, nanoseconds laxity, double utilization, nanoseconds deadline = 100ms) {
    SlotView v;
    v.task = index;
    v.blocking = true;
    v.laxity = laxity;
    v.deadline = deadline;
    v.utilization = utilization;
    return v;
}

sched::Decision decide_for(const SlotView& self, const std::vector<SlotView>& others,
                           const Scheduler& scheduler) {
    std::vector<SlotView> tasks{self};
    tasks.insert(tasks.end(), others.begin(), others.end());
    return decide(scheduler, {0ns, tasks});
}

}  // namespace

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
}

TEST_CASE("Urgency ranks tasks past the point of no return last", "[sched][policy]") {
    CHECK(decide_for(task(0, 100ms, 1.0), {task(1, -1ms, 1.0)}, kUrgency).rank == 0);
    CHECK(decide_for(task(0, -1ms, 1.0), {task(1, 100ms, 1.0)}, kUrgency).rank == 1);
}

TEST_CASE("Ties go to the lower task, so exactly one of two is first", "[sched][policy]") {
    const SlotView a = task(0, 7ms, 1.0), b = task(1, 7ms, 1.0);
    CHECK(decide_for(a, {b}, kUrgency).rank == 0);
    CHECK(decide_for(b, {a}, kUrgency).rank == 1);
}

TEST_CASE("Edf ranks by deadline, not by what remains", "[sched][policy]") {
    Scheduler edf;
    edf.policy = config::Policy::kEdf;
    const SlotView soon = task(0, 40ms, 1.0, 60ms), busy = task(1, 10ms, 1.0, 120ms);
    CHECK(decide_for(soon, {busy}, edf).rank == 0);
    CHECK(decide_for(soon, {busy}, kUrgency).rank == 1);  // urgency says otherwise
    const SlotView late = task(2, -1ms, 1.0, 10ms);
    CHECK(decide_for(late, {busy}, edf).rank == 1);
}

TEST_CASE("Admission none admits everything and still ranks", "[sched][admission]") {
    Scheduler none = kUrgency;
    none.admission = config::Admission::kNone;
    const auto d = decide_for(task(0, 10ms, 1.0), {task(1, 5ms, 1.0)}, none);
    CHECK(d.admit);
    CHECK(d.rank == 1);
}

TEST_CASE("Priorities follow the rank and share the least level at the end", "[sched][priority]") {
    // Six levels, as an RTX 3070 Ti and an H200 have.
    CHECK(sched::priority_of_rank(0, 0, -5) == -5);
    CHECK(sched::priority_of_rank(4, 0, -5) == -1);
    CHECK(sched::priority_of_rank(5, 0, -5) == 0);
    CHECK(sched::priority_of_rank(40, 0, -5) == 0);
    CHECK(sched::priority_of_rank(3, 0, 0) == 0);  // a device without priorities
}

namespace {

SlotView job(int index, nanoseconds deadline, nanoseconds gpu, nanoseconds period = 200ms) {
    SlotView v = task(index, deadline - gpu, 1.0, deadline);
    v.remaining_gpu = gpu;
    v.period = period;
    return v;
}

std::vector<int> order_of(const std::vector<SlotView>& tasks, nanoseconds now = 0ns) {
    std::vector<sched::Key> keys(tasks.size());
    sched::feasible_keys({now, tasks}, keys);
    std::vector<int> order;
    for (const SlotView& v : tasks) order.push_back(v.task);
    std::sort(order.begin(), order.end(), [&](int a, int b) { return keys[a] < keys[b]; });
    return order;
}

}  // namespace

TEST_CASE("Feasible is deadline order when all can be met", "[sched][policy]") {
    CHECK(order_of({job(0, 90ms, 30ms), job(1, 30ms, 30ms), job(2, 60ms, 30ms)}) ==
          std::vector{1, 2, 0});
}

TEST_CASE("Feasible gives up the largest of those that cannot all be met", "[sched][policy]") {
    // 10 + 40 + 15 ms do not fit into 60 ms; without the 40 ms both others do.
    CHECK(order_of({job(0, 20ms, 10ms), job(1, 50ms, 40ms), job(2, 60ms, 15ms)}) ==
          std::vector{0, 2, 1});
}

TEST_CASE("Feasible gives up the frame of the chain that has most frames", "[sched][policy]") {
    CHECK(order_of({job(0, 40ms, 30ms, 500ms), job(1, 41ms, 29ms, 100ms)}) == std::vector{0, 1});
    CHECK(order_of({job(0, 40ms, 30ms, 100ms), job(1, 41ms, 29ms, 500ms)}) == std::vector{1, 0});
}

TEST_CASE("Feasible gives up as many as it takes", "[sched][policy]") {
    // Giving up the first frees 5 ms of 45 for its weight; the kept ones still do not fit.
    CHECK(order_of({job(0, 30ms, 5ms, 10ms), job(1, 40ms, 20ms, 300ms),
                    job(2, 41ms, 40ms, 900ms)}) == std::vector{2, 0, 1});
}

TEST_CASE("Feasible counts the CPU time that is still to come", "[sched][policy]") {
    SlotView cpu_later = job(0, 60ms, 20ms);
    cpu_later.remaining_cpu = 35ms;  // its GPU work must be done by 25 ms
    cpu_later.laxity = 5ms;
    CHECK(order_of({cpu_later, job(1, 50ms, 20ms)}) == std::vector{0, 1});
}

TEST_CASE("Feasible puts what is late anyway behind what was given up", "[sched][policy]") {
    SlotView late = job(0, 10ms, 20ms);
    CHECK(late.laxity < 0ns);
    CHECK(order_of({late, job(1, 50ms, 40ms), job(2, 54ms, 15ms, 900ms)}) == std::vector{2, 1, 0});
}

TEST_CASE("Feasible takes an instance back when time allows it again", "[sched][policy]") {
    const std::vector early{job(0, 100ms, 60ms), job(1, 90ms, 50ms)};
    CHECK(order_of(early) == std::vector{1, 0});
    // The other one is nearly done: both fit, in deadline order.
    CHECK(order_of({job(0, 100ms, 60ms), job(1, 90ms, 5ms)}, 30ms) == std::vector{1, 0});
    CHECK(decide_for(job(0, 100ms, 60ms), {job(1, 90ms, 50ms)}, Scheduler{}).rank == 1);
    CHECK(decide_for(job(0, 100ms, 60ms), {}, Scheduler{}).rank == 0);
}
