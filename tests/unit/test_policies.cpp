// SPDX-License-Identifier: Apache-2.0
#include "host/sched/policy.h"

#include <algorithm>
#include <numeric>
#include <vector>

#include "tests/support/catch.h"
#include "tests/support/slot_views.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
using config::Policy;
using config::Scheduler;
using model::SlotView;
using sched::nanoseconds;

namespace {

/// A frame that arrived at `arrival`, all of whose chain's work is still to come.
SlotView frame(int index, nanoseconds arrival, nanoseconds deadline, nanoseconds cpu,
               nanoseconds gpu, nanoseconds period = 200ms) {
    SlotView v = job(index, arrival + deadline, gpu, period);
    v.chain.relative_deadline = deadline;
    v.remaining.cpu = v.chain.cpu = cpu;
    v.chain.gpu = gpu;
    v.laxity = v.deadline - cpu - gpu;
    return v;
}

std::vector<int> order_of(Policy policy, const std::vector<SlotView>& tasks, nanoseconds now = 0ns,
                          double lambda = 1) {
    Scheduler scheduler;
    scheduler.policy = policy;
    scheduler.parameters.lambda = lambda;
    std::vector<sched::Key> keys;
    for (const SlotView& v : tasks)
        keys.push_back(sched::policy_key(scheduler.policy, {now, scheduler.parameters.lambda}, v));
    std::vector<std::size_t> by_key(tasks.size());
    std::iota(by_key.begin(), by_key.end(), 0);
    std::sort(by_key.begin(), by_key.end(), [&](auto a, auto b) { return keys[a] < keys[b]; });
    std::vector<int> order;
    for (const std::size_t i : by_key) order.push_back(tasks[i].task);
    return order;
}

}  // namespace

TEST_CASE("Urgency ranks tasks past the point of no return last", "[sched][policy]") {
    CHECK(decide_for(task(0, 100ms, 1.0), {task(1, -1ms, 1.0)}, kUrgency).rank == 0);
    CHECK(decide_for(task(0, -1ms, 1.0), {task(1, 100ms, 1.0)}, kUrgency).rank == 1);
    // 1 / laxity, as among the others.
    CHECK(decide_for(task(0, -50ms, 1.0), {task(1, -1ms, 1.0)}, kUrgency).rank == 0);
    CHECK(decide_for(task(0, -1ms, 1.0), {task(1, -50ms, 1.0)}, kUrgency).rank == 1);
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

TEST_CASE("Eqdf adds a share of the CPU time to the deadline", "[sched][policy]") {
    const std::vector tasks{frame(0, 0ms, 100ms, 40ms, 10ms), frame(1, 0ms, 110ms, 20ms, 10ms)};
    CHECK(order_of(Policy::kEqdf, tasks, 0ns, 0) == std::vector{0, 1});
    CHECK(order_of(Policy::kEqdf, tasks, 0ns, 1) == std::vector{1, 0});   // 140 and 130
    CHECK(order_of(Policy::kEqdf, tasks, 0ns, -1) == std::vector{0, 1});  // 60 and 90
    const std::vector late{frame(0, 0ms, 10ms, 5ms, 10ms), tasks[1]};
    CHECK(order_of(Policy::kEqdf, late) == std::vector{1, 0});
}

TEST_CASE("Saedf adds a share of the GPU time, in which the CPU is suspended", "[sched][policy]") {
    const std::vector tasks{frame(0, 0ms, 100ms, 10ms, 40ms), frame(1, 0ms, 110ms, 40ms, 20ms)};
    CHECK(order_of(Policy::kSaedf, tasks, 0ns, 1) == std::vector{1, 0});  // 140 and 130
    CHECK(order_of(Policy::kSaedf, tasks, 0ns, -1) == std::vector{0, 1});
    const std::vector late{frame(0, 0ms, 10ms, 5ms, 10ms), tasks[1]};
    CHECK(order_of(Policy::kSaedf, late) == std::vector{1, 0});
    std::vector half_done = tasks;
    half_done[0].remaining.gpu = 5ms;  // the chain's time counts, whatever is done of it
    CHECK(order_of(Policy::kSaedf, half_done, 0ns, 1) == std::vector{1, 0});
}

TEST_CASE("Lcuf ranks by the chain's share of its period", "[sched][policy]") {
    CHECK(order_of(Policy::kLcuf, {frame(0, 0ms, 50ms, 10ms, 20ms, 100ms),      // 0.3
                                   frame(1, 0ms, 90ms, 50ms, 50ms, 500ms)}) ==  // 0.2
          std::vector{1, 0});
    std::vector tasks{frame(0, 0ms, 50ms, 20ms, 10ms, 100ms),
                      frame(1, 0ms, 90ms, 5ms, 20ms, 100ms)};
    CHECK(order_of(Policy::kLcuf, tasks) == std::vector{1, 0});  // 0.3 and 0.25
    tasks[0].remaining.cpu = 0ns;                                // whatever is done of it
    tasks[0].remaining.gpu = 1ms;
    CHECK(order_of(Policy::kLcuf, tasks) == std::vector{1, 0});
    tasks[0].period = 0ns;  // of a chain without one nobody knows the share
    CHECK(order_of(Policy::kLcuf, tasks) == std::vector{0, 1});
}

TEST_CASE("Sjf ranks by what remains", "[sched][policy]") {
    CHECK(order_of(Policy::kSjf, {frame(0, 0ms, 50ms, 10ms, 20ms),
                                  frame(1, 0ms, 90ms, 9ms, 20ms)}) == std::vector{1, 0});
    std::vector tasks{frame(0, 0ms, 50ms, 10ms, 40ms), frame(1, 0ms, 90ms, 20ms, 20ms)};
    CHECK(order_of(Policy::kSjf, tasks) == std::vector{1, 0});
    tasks[0].remaining.gpu = 20ms;  // half of it is done
    CHECK(order_of(Policy::kSjf, tasks) == std::vector{0, 1});
}

TEST_CASE("Hrrn ranks by how much longer than its work a frame has been there", "[sched][policy]") {
    // At 60 ms: (60 + 30) / 30 = 3, and (40 + 10) / 10 = 5.
    CHECK(order_of(Policy::kHrrn,
                   {frame(0, 0ms, 100ms, 10ms, 20ms), frame(1, 20ms, 100ms, 5ms, 5ms)},
                   60ms) == std::vector{1, 0});
    // At 22 ms: 1.7, and 1.2.
    CHECK(order_of(Policy::kHrrn,
                   {frame(0, 0ms, 100ms, 10ms, 20ms), frame(1, 20ms, 100ms, 5ms, 5ms)},
                   22ms) == std::vector{0, 1});
    // At 30 ms, with the same GPU time: (30 + 50) / 50 = 1.6, and (30 + 20) / 20 = 2.5.
    CHECK(order_of(Policy::kHrrn,
                   {frame(0, 0ms, 100ms, 40ms, 10ms), frame(1, 0ms, 100ms, 10ms, 10ms)},
                   30ms) == std::vector{1, 0});
    // Without a profile nobody knows how long anything takes: that goes first, and by no more than
    // can be told apart.
    const std::vector unknown{frame(0, 0ms, 100ms, 1ms, 1ms), frame(1, 20ms, 100ms, 0ms, 0ms),
                              frame(2, 10ms, 100ms, 0ms, 0ms)};
    CHECK(order_of(Policy::kHrrn, unknown, 30ms) == std::vector{2, 1, 0});
    CHECK(sched::hrrn_key(unknown[1], 1h) == -1'000'000'000'000'000'000);
    CHECK(sched::hrrn_key(unknown[1], 10h) == sched::hrrn_key(unknown[1], 1h));
}

TEST_CASE("Fifo ranks by arrival, static by the chain, utilization by the launch",
          "[sched][policy]") {
    SlotView a = frame(0, 10ms, 50ms, 1ms, 1ms), b = frame(1, 5ms, 100ms, 1ms, 1ms);
    CHECK(order_of(Policy::kFifo, {a, b}) == std::vector{1, 0});
    a.chain.static_rank = 0;
    b.chain.static_rank = 1;
    CHECK(order_of(Policy::kStatic, {b, a}) == std::vector{0, 1});
    a.utilization = 0.9;
    b.utilization = 0.2;
    CHECK(order_of(Policy::kUtilization, {a, b}) == std::vector{1, 0});
}
