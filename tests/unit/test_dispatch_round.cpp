// SPDX-License-Identifier: Apache-2.0
//
// Which closed gates a round of the dispatcher opens.
#include "host/sched/dispatch_round.h"

#include <algorithm>
#include <memory>

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using sched::nanoseconds;

namespace {

std::int64_t ns(nanoseconds time) {
    return time.count();
}

/// Tasks on the GPU with deadlines 10 ms apart, task 0 the first; each has launched 2 ms, of which
/// nothing has executed, and has 4 ms left.
struct Page {
    std::unique_ptr<abi::SharedPage> page = std::make_unique<abi::SharedPage>();
    sched::HostRounds rounds{*page};
    nanoseconds now = 1000ms;

    explicit Page(int num_tasks) {
        abi::DispatchSettings& d = page->dispatch;
        d.policy = static_cast<std::uint32_t>(config::Policy::kEdf);
        d.pack_limit_ppm = 1'050'000;
        d.share_limit_ppm = 1'050'000;
        d.share_slack_ns = ns(10ms);
        for (int i = 0; i < num_tasks; ++i) {
            abi::TaskSlot& s = slot(i);
            page->active[0] |= 1ull << i;
            s.state = abi::TaskState::kGpu;
            s.deadline_ns = ns(now + 30ms + i * 10ms);
            s.relative_deadline_ns = ns(100ms);
            s.period_ns = ns(100ms);
            s.head_utilization_ppm = 800'000;
            s.head_remaining_ns = ns(4ms);
            s.launched_ns = ns(2ms);
            s.launch_ns = s.look_ns = s.progress_ns = ns(now);
            s.is_supported = 1;
            s.run_ahead_ns = ns(10ms);
            s.gate_by_ns = ns(now + 1s);
        }
    }
    abi::TaskSlot& slot(int task) { return page->tasks[task]; }
    /// A gate before so much of what the task has launched.
    void close(int task, nanoseconds group = 200us, std::uint32_t utilization_ppm = 800'000) {
        abi::TaskSlot& s = slot(task);
        const std::uint32_t gate = ++s.gates_closed, at = gate % abi::kGateRing;
        s.group_begin_ns[at] = s.launched_ns.load();
        s.group_time_ns[at] = ns(group);
        s.group_utilization_ppm[at] = utilization_ppm;
        s.launched_ns += ns(group);
    }
    void executed_all(int task) {
        abi::TaskSlot& s = slot(task);
        s.launched_at_mark_ns[1] = s.launched_ns.load();
        s.marks_issued = s.marks_done = 1;
        s.waits = 1;
    }
    bool opens(int task) {
        const std::uint32_t before = slot(task).gates_opened;
        rounds.run(now);
        return slot(task).gates_opened != before;
    }
};

}  // namespace

TEST_CASE("A gate opens once nothing more urgent blocks", "[sched][dispatch_round]") {
    Page p(2);
    p.close(1);
    CHECK_FALSE(p.opens(1));
    CHECK(p.rounds.run(p.now) == 1);
    p.executed_all(0);
    CHECK(p.opens(1));
    CHECK(p.slot(1).gate_opened_ns == ns(p.now));
    CHECK(p.rounds.run(p.now) == 0);
}

TEST_CASE("The gate of the most urgent task opens at once", "[sched][dispatch_round]") {
    Page p(2);
    p.close(0);
    CHECK(p.opens(0));
}

TEST_CASE("A group that fits beside what is more urgent goes", "[sched][dispatch_round]") {
    Page p(2);
    const std::uint32_t utilization_ppm = GENERATE(200'000, 300'000);
    p.close(1, 200us, utilization_ppm);
    CHECK(p.opens(1) == (utilization_ppm == 200'000));  // beside 0.8, at most 1.05
}

TEST_CASE("A gated task blocks those behind it, its group as long as it stands there",
          "[sched][dispatch_round]") {
    Page p(3);
    p.executed_all(0);
    p.close(1);
    p.close(2);
    p.rounds.run(p.now);
    CHECK(p.slot(1).gates_opened == 1);
    CHECK(p.slot(2).gates_opened == 0);
}

TEST_CASE("Gates of a task open as far as its run-ahead, in order", "[sched][dispatch_round]") {
    Page p(1);
    p.slot(0).run_ahead_ns = ns(2500us);
    for (int i = 0; i < 6; ++i) p.close(0, 300us);  // from 2.0, 2.3, 2.6, ... ms on
    p.rounds.run(p.now);
    CHECK(p.slot(0).gates_opened == 2);
    p.slot(0).launched_at_mark_ns[1] = ns(1ms);
    p.slot(0).marks_issued = p.slot(0).marks_done = 1;
    p.rounds.run(p.now);  // to 3.5 ms
    CHECK(p.slot(0).gates_opened == 6);
}

TEST_CASE("A round opens a few gates of a task at most", "[sched][dispatch_round]") {
    Page p(1);
    for (int i = 0; i < 9; ++i) p.close(0, 10us);
    p.rounds.run(p.now);
    CHECK(p.slot(0).gates_opened == sched::kMostOpenedAtOnce);
}

TEST_CASE("All gates of a task open when its time has come, and while gates are parked",
          "[sched][dispatch_round]") {
    Page p(2);
    for (int i = 0; i < 9; ++i) p.close(1);
    CHECK_FALSE(p.opens(1));
    SECTION("time") {
        p.slot(1).gate_by_ns = ns(p.now);
    }
    SECTION("parked") {
        p.page->dispatch.parked = 1;
    }
    CHECK(p.opens(1));
    CHECK(p.slot(1).gates_opened == 9);
}

TEST_CASE("What waits behind a gate is not overdue, and is again once it is open",
          "[sched][dispatch_round]") {
    Page p(2);
    const bool has_executed = GENERATE(true, false);  // what is before the gate
    if (has_executed) p.executed_all(0);
    p.slot(0).waits = 0;
    p.close(0);
    const auto view = [&] {
        model::TaskReading r = model::load_slot(p.slot(0));
        model::load_marks(r, p.slot(0), p.slot(0).marks_issued, p.slot(0).marks_done);
        return model::view_of(r, 0, p.now);
    };
    p.now += 100ms;
    CHECK(view().state.blocking == has_executed);
    CHECK(view().state.overdue != has_executed);
    p.slot(0).gates_opened = 1;
    p.slot(0).gate_opened_ns = ns(p.now);
    CHECK_FALSE(view().state.overdue);
    p.now += 100ms;
    CHECK(view().state.overdue);
}

TEST_CASE("The plan's bits decide of a gate as of a launch", "[sched][dispatch_round]") {
    Page p(2);
    p.page->dispatch.policy = static_cast<std::uint32_t>(config::Policy::kFeasible);
    p.close(1);
    CHECK_FALSE(p.opens(1));
    SECTION("what is given up blocks nobody") {
        p.page->dispatch.given_up[0] = 1;
    }
    SECTION("who may share, shares") {
        p.page->dispatch.share_limit_ppm = 1'600'000;
        p.page->dispatch.may_share[0] = 2;
    }
    CHECK(p.opens(1));
}

TEST_CASE("A round tells the laxity and the rank of each active task", "[sched][dispatch_round]") {
    Page p(3);
    p.page->active[0] = 0b101;
    p.slot(0).deadline_ns = ns(p.now + 90ms);
    p.rounds.run(p.now);
    const auto told = [&](int task) { return abi::RankedWord::of(p.page->ranked[task]); };
    CHECK(told(0).rank == 2);
    CHECK(told(1).rank == 0);
    CHECK(told(2).rank == 1);
    CHECK(nanoseconds(told(0).laxity_ns) == 84ms);  // it has 4 ms to launch, and launched 2
    CHECK(nanoseconds(told(2).laxity_ns) == 44ms);
}

TEST_CASE("A laxity and a rank are one word", "[sched][dispatch_round]") {
    for (const std::int64_t laxity_ns :
         {std::int64_t{0}, std::int64_t{-1}, std::int64_t{123'456'789'012'345},
          std::int64_t{-123'456'789'012'345}, std::int64_t{INT64_MAX}, std::int64_t{INT64_MIN}})
        for (const int rank : {0, 1, abi::kMaxTasks}) {
            const auto word = abi::RankedWord::of(abi::RankedWord{laxity_ns, rank}.pack());
            CHECK(word.rank == rank);
            CHECK(word.laxity_ns == std::clamp(laxity_ns, -abi::RankedWord::kMostLaxity_ns,
                                               +abi::RankedWord::kMostLaxity_ns));
        }
}

TEST_CASE("The host is silent once it has not beaten for 10 ms", "[sched][dispatch_round]") {
    abi::DispatchSettings page{};
    page.beat_ns = ns(10ms);
    CHECK_FALSE(sched::is_silent(page, 20ms));
    CHECK(sched::is_silent(page, 20ms + 1ns));
    CHECK_FALSE(sched::is_silent(page, 9ms));
}

TEST_CASE("The host opens a gate once, and never closes one", "[sched][dispatch_round]") {
    abi::TaskSlot slot{};
    CHECK(sched::open_gate(slot, 3, 5ms));
    CHECK_FALSE(sched::open_gate(slot, 3, 6ms));
    CHECK_FALSE(sched::open_gate(slot, 2, 6ms));
    CHECK(slot.gates_opened == 3);
    CHECK(slot.gate_opened_ns == ns(5ms));
    slot.gates_opened = 0xfffffffe;  // numbers wrap
    CHECK(sched::open_gate(slot, 1, 7ms));
}

TEST_CASE("The GPU's clock is the host's but for a difference, whatever its high bits are",
          "[sched][dispatch_round]") {
    abi::DispatchSettings page{};
    const std::int64_t host_ns = 77'000'000'000'123;
    const std::uint64_t globaltimer = 0x1234'5678'9abc'def0;
    page.gpu_clock_ahead = (globaltimer & 0xffff'ffff'ffff) - static_cast<std::uint64_t>(host_ns);
    page.clock_base_ns = host_ns - 5'000'000'000;
    CHECK(sched::host_time(page, globaltimer) == nanoseconds(host_ns));
    CHECK(sched::host_time(page, globaltimer + 999) == nanoseconds(host_ns + 999));
}
