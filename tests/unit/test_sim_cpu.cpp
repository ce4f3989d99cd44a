// SPDX-License-Identifier: Apache-2.0
//
// The simulator's CPU, with times reckoned by hand.
#include <map>

#include "tests/support/catch.h"
#include "tools/sim/cpu_model.h"

using namespace urgengo::sim;

namespace {

std::map<int, std::int64_t> run(CpuModel& cpu) {
    std::map<int, std::int64_t> ends;
    for (nanoseconds t = cpu.next(); t != kNever; t = cpu.next())
        for (const int thread : cpu.advance(t)) ends[thread] = t.count();
    return ends;
}

using Ends = std::map<int, std::int64_t>;

}  // namespace

TEST_CASE("Threads share cores only when there are more of them", "[unit][sim]") {
    CpuModel two({2}, 1), one({1}, 1);
    for (CpuModel* cpu : {&two, &one}) {
        cpu->compute(0, nanoseconds{100});
        cpu->compute(1, nanoseconds{300});
    }
    CHECK(run(two) == Ends{{0, 100}, {1, 300}});
    CHECK(run(one) == Ends{{0, 200}, {1, 400}});
    CHECK(one.core_seconds() == Approx(400e-9));
    CHECK(two.core_seconds() == Approx(400e-9));
}

TEST_CASE("A thread that spins holds a core", "[unit][sim]") {
    CpuModel cpu({1}, 1);
    cpu.begin_spin();
    cpu.compute(0, nanoseconds{100});
    CHECK(cpu.next() == nanoseconds{200});
    cpu.advance(nanoseconds{100});
    cpu.end_spin();
    CHECK(run(cpu) == Ends{{0, 150}});
}

TEST_CASE("Threads that stand still go on where they were", "[unit][sim]") {
    CpuModel cpu({2}, 1);
    cpu.compute(0, nanoseconds{100});
    cpu.launch(1, nanoseconds{300});
    cpu.stall(true, nanoseconds{40});
    CHECK(cpu.next() == kNever);
    cpu.stall(false, nanoseconds{1040});
    CHECK(run(cpu) == Ends{{0, 1100}, {1, 1300}});
    CHECK(cpu.core_seconds() == Approx(400e-9));
}

TEST_CASE("Threads that launch slow each other down if they share what it takes", "[unit][sim]") {
    // Two get 2 * 1 / 2 done together, so each takes twice its time.
    CpuModel cpu({.num_cores = 16, .launch_capacity = 1}, 1);
    cpu.launch(0, nanoseconds{200});
    cpu.launch(1, nanoseconds{200});
    cpu.compute(2, nanoseconds{200});
    CHECK(run(cpu) == Ends{{0, 400}, {1, 400}, {2, 200}});
    CpuModel alone({.num_cores = 16, .launch_capacity = 1}, 1);
    alone.launch(0, nanoseconds{200});
    CHECK(run(alone) == Ends{{0, 200}});
}

TEST_CASE("Sleeping threads wake up late, by the same each time that a seed is given",
          "[unit][sim]") {
    CpuModel a({}, 1), b({}, 1);
    double sum_ns = 0;
    for (int i = 0; i < 1000; ++i) {
        const nanoseconds delay = a.wake_up_delay();
        CHECK(delay == b.wake_up_delay());
        CHECK(delay > CpuShape{}.wake_up);
        sum_ns += double(delay.count());
    }
    CHECK(sum_ns / 1000 == Approx(34'000).epsilon(0.03));
}
