// SPDX-License-Identifier: Apache-2.0
#include "host/sched/policies/feasible.h"

#include <algorithm>
#include <tuple>
#include <vector>

#include "tests/support/catch.h"
#include "tests/support/slot_views.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
using model::SlotView;
using sched::nanoseconds;

namespace {

constexpr nanoseconds kShareSlack{5ms};

std::vector<int> order_of(const std::vector<SlotView>& tasks, nanoseconds now = 0ns) {
    sched::Snapshot snapshot{now, tasks};
    snapshot.plan = sched::make_plan(now, tasks, 0, kShareSlack);
    std::vector<SlotView> sorted = tasks;
    std::sort(sorted.begin(), sorted.end(), [&](const auto& a, const auto& b) {
        const auto key = [&](const SlotView& v) {
            return sched::feasible_key(v,
                                       {.now = now,
                                        .given_up = snapshot.plan.given_up.contains(v.task),
                                        .late_first = snapshot.plan.late_first.contains(v.task)});
        };
        return key(a) < key(b);
    });
    std::vector<int> order;
    for (const SlotView& v : sorted) order.push_back(v.task);
    return order;
}

std::vector<int> given_up(const std::vector<SlotView>& tasks, nanoseconds now = 0ns,
                          double margin = 0) {
    return slots_of(sched::make_plan(now, tasks, margin, kShareSlack).given_up);
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
    cpu_later.remaining.cpu = cpu_later.later.cpu = 35ms;  // its GPU work must be done by 25 ms
    cpu_later.laxity = 5ms;
    CHECK(order_of({cpu_later, job(1, 50ms, 20ms)}) == std::vector{0, 1});
    CHECK(given_up({cpu_later, job(1, 24ms, 10ms)}) == std::vector{0});
}

TEST_CASE("Feasible plans from now on, and an instance without any slack can be met",
          "[sched][policy]") {
    const std::vector tasks{job(0, 60ms, 25ms), job(1, 70ms, 20ms)};
    CHECK(given_up(tasks).empty());
    CHECK(given_up(tasks, 30ms) == std::vector{0});
    CHECK(given_up({job(0, 20ms, 20ms), job(1, 15ms, 10ms)}) == std::vector{0});
}

TEST_CASE("Feasible gives up nobody who is not in the way", "[sched][policy]") {
    // By far the largest begins when the others are over.
    CHECK(given_up({job(0, 20ms, 15ms), job(1, 21ms, 14ms), later_job(2, 100ms, 200ms, 80ms)}) ==
          std::vector{0});
}

TEST_CASE("Feasible keeps those given up in deadline order", "[sched][policy]") {
    CHECK(order_of({job(0, 60ms, 50ms), job(1, 55ms, 50ms), job(2, 30ms, 25ms)}) ==
          std::vector{2, 1, 0});
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
}

TEST_CASE("Feasible gives up an instance for one whose CPU segment is about to end",
          "[sched][policy]") {
    // From 10 ms on the second needs 30 of 32 ms; the first would still be at it for 10 more.
    CHECK(given_up({job(0, 100ms, 20ms), later_job(1, 10ms, 42ms, 30ms)}).empty());
    CHECK(given_up({job(0, 30ms, 20ms), later_job(1, 10ms, 42ms, 30ms)}) == std::vector{1});
    CHECK(given_up({job(0, 30ms, 20ms, 100ms), later_job(1, 10ms, 42ms, 15ms)}) ==
          std::vector<int>{});
}

TEST_CASE("Feasible plans for frames that are expected, and gives up none of them",
          "[sched][policy]") {
    SlotView next = later_job(SlotView::kExpected, 10ms, 45ms, 30ms);
    next.period = 500ms;
    CHECK(given_up({job(0, 30ms, 20ms), next}) == std::vector{0});
    next.period = 100ms;  // it is the one that gives way
    CHECK(given_up({job(0, 30ms, 20ms), next}).empty());
}

TEST_CASE("Feasible lets others run while an instance is between two GPU segments",
          "[sched][policy]") {
    // 10 ms, 20 ms on the CPU, 10 ms: 40 of 45 ms. Between them is room for 20 ms.
    CHECK(given_up({two_part_job(0, 45ms, 10ms, 20ms), job(1, 40ms, 20ms)}).empty());
    CHECK_FALSE(given_up({two_part_job(0, 45ms, 10ms, 20ms), job(1, 40ms, 26ms)}).empty());
    // The other one begins shortly before its second part, which then ends too late.
    CHECK(given_up({two_part_job(0, 41ms, 10ms, 20ms), later_job(1, 28ms, 35ms, 5ms)}) ==
          std::vector{0});
    // Its first part is due by 15 ms, whatever the deadline at the end.
    CHECK(order_of({job(1, 40ms, 5ms), two_part_job(0, 45ms, 10ms, 20ms)}) == std::vector{0, 1});
}

TEST_CASE("Feasible gives up the least critical first, and runs the most critical first of those",
          "[sched][policy]") {
    SlotView critical = job(0, 50ms, 40ms, 100ms), other = job(1, 48ms, 15ms, 500ms);
    CHECK(given_up({critical, other}) == std::vector{0});  // it frees more for what it costs
    critical.chain.criticality = 2;
    CHECK(given_up({critical, other}) == std::vector{1});
    critical.deadline = 39ms + 50ms;
    SlotView a = job(2, 50ms, 45ms), b = job(3, 60ms, 45ms), c = job(4, 55ms, 52ms);
    c.chain.criticality = 3;
    b.chain.criticality = 2;
    CHECK(order_of({a, b, c}) == std::vector{4, 3, 2});
}

TEST_CASE("Feasible keeps time free before a more critical deadline, if it costs the less critical",
          "[sched][policy]") {
    // 3 ms and an eighth of 40 ms: it is to end by 52 ms.
    SlotView critical = job(0, 60ms, 40ms);
    critical.chain.criticality = 2;
    CHECK(given_up({critical, job(1, 50ms, 12ms)}).empty());
    CHECK(given_up({critical, job(1, 50ms, 13ms)}) == std::vector{1});
    critical.chain.criticality = 1;
    CHECK(given_up({critical, job(1, 50ms, 20ms)}).empty());
    // Not more than it has: one that must go at once harms nobody behind it.
    SlotView urgent = job(0, 21ms, 20ms);
    urgent.chain.criticality = 2;
    CHECK(given_up({urgent, job(1, 100ms, 10ms)}).empty());
}

TEST_CASE("Feasible takes any number of instances, none and more than there are slots",
          "[sched][policy]") {
    CHECK(sched::make_plan(0ns, {}, 0, kShareSlack).given_up.is_empty());
    std::vector<SlotView> many;
    for (int i = 0; i < 64; ++i) many.push_back(job(i, 100ms, 50ms));
    for (int i = 0; i < 40; ++i) many.push_back(later_job(SlotView::kExpected, 10ms, 100ms, 50ms));
    CHECK(given_up(many).size() == 62);
    for (int i = 64; i < 256; ++i) many.push_back(job(i, 100ms, 50ms));
    CHECK(given_up(many).size() == 254);
    sched::PlanScratch scratch(64);  // the others are left out
    CHECK(slots_of(sched::make_plan(0ns, many, 0, kShareSlack, scratch).given_up).size() == 62);
}

TEST_CASE("With a margin there must be room for more than what remains", "[sched][policy]") {
    const std::vector tasks{job(0, 20ms, 20ms), job(1, 45ms, 20ms)};
    CHECK(given_up(tasks).empty());
    CHECK(given_up({job(0, 24ms, 20ms), job(1, 45ms, 20ms)}, 0ns, 0.1).empty());
    CHECK(given_up({job(0, 24ms, 20ms), job(1, 45ms, 20ms)}, 0ns, 0.2).size() == 1);
    CHECK(given_up({two_part_job(0, 45ms, 10ms, 20ms)}, 0ns, 0.2).empty());
    CHECK(given_up({two_part_job(0, 45ms, 10ms, 20ms)}, 0ns, 0.5) == std::vector{0});  // 15, 20, 15
}

TEST_CASE("A plan knows by how much its tightest instance is in time", "[sched][policy]") {
    const auto slack = [](const std::vector<SlotView>& tasks) {
        return sched::make_plan(0ns, tasks, 0, kShareSlack).slack;
    };
    CHECK(slack({job(0, 30ms, 20ms), job(1, 45ms, 20ms)}) == 5ms);
    CHECK(slack({job(0, 30ms, 20ms), job(1, 65ms, 20ms)}) == 10ms);
    CHECK(slack({job(0, 30ms, 20ms), job(1, 35ms, 30ms)}) == 10ms);  // the other is given up
    CHECK(slack({}) == nanoseconds::max());
    CHECK(slack({job(0, 60ms, 20ms), job(1, 25ms, 0ms)}) == 40ms);  // the other one needs no GPU
}

TEST_CASE("A plan has no slack where nobody knows what a chain on the GPU needs",
          "[sched][policy]") {
    std::vector tasks{job(0, 30ms, 20ms), job(1, 65ms, 20ms)};
    tasks[1].chain.gpu = 0ns;
    CHECK(sched::make_plan(0ns, tasks, 0, kShareSlack).slack == 0ns);
    tasks[1].state.ranked = false;
    CHECK(sched::make_plan(0ns, tasks, 0, kShareSlack).slack == 10ms);
}

TEST_CASE("Feasible knows that two launch-bound instances fit side by side", "[sched][policy]") {
    CHECK(given_up({half_busy_job(0, 21ms, 20ms), half_busy_job(1, 22ms, 20ms)}).empty());
    // But each takes its time alone, and three are too many.
    CHECK(given_up({half_busy_job(0, 21ms, 20ms), half_busy_job(1, 22ms, 20ms),
                    half_busy_job(2, 23ms, 20ms)}) == std::vector{2});
}

TEST_CASE("Feasible gives what a launch-bound instance leaves to one that is GPU-bound",
          "[sched][policy]") {
    CHECK(given_up({half_busy_job(0, 20ms, 20ms), job(1, 31ms, 20ms)}).empty());
    CHECK(given_up({half_busy_job(0, 20ms, 20ms), job(1, 29ms, 20ms)}) == std::vector{1});
}

TEST_CASE("Feasible plans two at a time of those that slow each other's launching",
          "[sched][policy][launching]") {
    const auto eager = [](int index, nanoseconds deadline) {
        SlotView v = job(index, deadline, 2ms);
        v.remaining.idle = 18ms;
        v.laxity = deadline - 20ms;
        return v;
    };
    std::vector<SlotView> three{eager(0, 21ms), eager(1, 22ms), eager(2, 39ms)};
    CHECK(given_up(three).empty());
    for (SlotView& v : three) v.launching.share = 0.5;
    CHECK(given_up(three) == std::vector{2});
    three[2] = eager(2, 41ms);
    CHECK(given_up(three).empty());
}

TEST_CASE("Feasible knows that those that launch in turn leave the GPU to others",
          "[sched][policy][launching]") {
    std::vector<SlotView> tasks;
    for (int i = 0; i < 2; ++i) {
        SlotView v = job(i, 21ms, 2ms);  // a tenth of the GPU
        v.remaining.idle = 18ms;
        v.laxity = 1ms;
        v.launching.share = 0.5;
        tasks.push_back(v);
    }
    tasks.push_back(job(2, 22ms, 14ms));
    CHECK(given_up(tasks).empty());
    tasks.back() = job(2, 22ms, 19ms);
    CHECK(given_up(tasks) == std::vector{2});
}

TEST_CASE("Feasible gives up only what its record supports", "[sched][policy]") {
    SlotView wrong = job(1, 50ms, 40ms);
    wrong.is_supported = false;
    CHECK(given_up({job(0, 20ms, 10ms), wrong, job(2, 60ms, 15ms)}) == std::vector{2});
    SlotView other = job(2, 60ms, 15ms), first = job(0, 20ms, 10ms);
    other.is_supported = first.is_supported = false;
    CHECK(given_up({first, wrong, other}).empty());
}

TEST_CASE("Feasible lets the least late catch up of those that slow each other's launching",
          "[sched][policy][launching]") {
    const nanoseconds now{100ms};
    const auto late = [&](int index, nanoseconds deadline, bool slowed) {
        SlotView v = job(index, deadline, 40ms);
        v.laxity = deadline - now - 40ms;
        v.chain.relative_deadline = 60ms;
        if (slowed) v.launching.slowed = model::Launching::kSlowed;
        return v;
    };
    SlotView in_time = job(0, 160ms, 50ms);
    in_time.laxity = 10ms;
    CHECK(order_of({in_time, late(1, 70ms, true), late(2, 90ms, true)}, now) ==
          std::vector{0, 2, 1});
    CHECK(order_of({in_time, late(1, 70ms, false), late(2, 90ms, false)}, now) ==
          std::vector{0, 1, 2});
    const auto key = [&](const SlotView& v) { return sched::feasible_key(v, {.now = now}); };
    CHECK(key(late(1, 90ms, false)) < key(late(2, 95ms, true)));
    // One that came before it was due is not the least late.
    SlotView early = late(3, 200ms, true);
    early.laxity = -1ns;
    CHECK(key(early) > key(late(1, 70ms, true)));
    // Who is lent a deadline, which is earlier than its own, is no less urgent for that.
    SlotView lent = late(3, 60ms, true);
    CHECK(key(lent) > key(late(1, 70ms, true)));
    lent.state.is_lent = true;
    CHECK(key(lent) < key(late(2, 90ms, true)));
}

TEST_CASE("Feasible goes by when work has to go on beside a busy bystander", "[sched][policy]") {
    SlotView few = job(0, 50ms, 4ms), many = job(1, 60ms, 4ms), late = job(2, 5ms, 10ms);
    CHECK(order_of({few, many}) == std::vector{0, 1});
    few.longer_beside = 2ms;
    many.longer_beside = 20ms;
    CHECK(order_of({few, many}) == std::vector{1, 0});
    many.longer_beside = 11ms;
    CHECK(order_of({few, many}) == std::vector{0, 1});
    late.longer_beside = 100ms;
    late.laxity = -5ms;
    const auto key = [&](const SlotView& v) { return sched::feasible_key(v, {}); };
    CHECK(key(late) > key(many));
}

TEST_CASE("Feasible puts a late instance first where that costs nobody a deadline",
          "[sched][policy]") {
    // 5 ms late, 10 ms of work; the others have 20 ms to spare.
    const SlotView late = job(2, 5ms, 10ms);
    CHECK(order_of({job(0, 50ms, 30ms), job(1, 90ms, 30ms), late}) == std::vector{2, 0, 1});
    CHECK(order_of({job(0, 39ms, 30ms), job(1, 90ms, 30ms), late}) == std::vector{0, 1, 2});
    // One of two fits: the first of them.
    const SlotView later = job(3, 8ms, 15ms);
    CHECK(order_of({job(0, 50ms, 30ms), late, later}) == std::vector{2, 0, 3});
    SlotView over = job(2, -5ms, 0ms);
    CHECK(order_of({job(0, 50ms, 30ms), over}) == std::vector{0, 2});
    over.ahead.launched = 4ms;  // by time it has executed
    CHECK(order_of({job(0, 50ms, 30ms), over}) == std::vector{2, 0});
    over.ahead.waited = 1ms;  // the GPU has been with others
    CHECK(order_of({job(0, 50ms, 30ms), over}) == std::vector{0, 2});
    SlotView demoted = late;
    demoted.state.demoted = true;
    CHECK(order_of({job(0, 50ms, 30ms), demoted}) == std::vector{0, 2});
}

TEST_CASE("Feasible puts no late instance first that takes turns at launching",
          "[sched][policy][launching]") {
    const auto slowed = [](int index, nanoseconds deadline, nanoseconds gpu) {
        SlotView v = job(index, deadline, gpu);
        v.launching.slowed = model::Launching::kSlowed;
        return v;
    };
    const SlotView late = slowed(2, 5ms, 10ms), later = slowed(3, 8ms, 10ms);
    CHECK(order_of({slowed(0, 90ms, 30ms), late}) == std::vector{0, 2});
    CHECK(order_of({late, later}) == std::vector{3, 2});
    // One that takes none still is, and so is one whose work should be over.
    CHECK(order_of({slowed(0, 90ms, 30ms), job(2, 5ms, 10ms), later}) == std::vector{2, 0, 3});
    SlotView over = slowed(2, -5ms, 0ms);
    over.ahead.launched = 4ms;
    CHECK(order_of({slowed(0, 90ms, 30ms), over}) == std::vector{2, 0});
}

TEST_CASE("Feasible tells for whom an instance is given up, and how late that one would be",
          "[sched][policy]") {
    const auto reasons = [](const std::vector<SlotView>& tasks) {
        sched::PlanScratch scratch(tasks.size());
        (void)sched::make_plan(0ns, tasks, 0, kShareSlack, scratch);
        std::vector<std::tuple<int, int, nanoseconds>> told;
        for (const auto& reason : scratch.reasons)
            told.emplace_back(reason.task, reason.missed->task, reason.by);
        return told;
    };
    using Told = std::vector<std::tuple<int, int, nanoseconds>>;
    CHECK(reasons({job(0, 30ms, 10ms), job(1, 40ms, 10ms)}).empty());
    // The long one makes room for the short one, which would end at 50 ms.
    CHECK(reasons({job(0, 45ms, 40ms), job(1, 46ms, 10ms)}) == Told{{0, 1, 4ms}});
    // It is the long one that would be late, at 50 ms.
    CHECK(reasons({job(0, 30ms, 10ms), job(1, 46ms, 40ms)}) == Told{{1, 1, 4ms}});
}
