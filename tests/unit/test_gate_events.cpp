// SPDX-License-Identifier: Apache-2.0
//
// What is counted and recorded of rounds and parks.
#include "host/runtime/gate_events.h"

#include <thread>

#include "tests/support/folder.h"
#include "tests/support/gates_fixture.h"
#include "tools/trace/run_reader.h"

using namespace urgengo;
using namespace urgengo::testing;
using abi::RunKind;
using abi::RunRecord;

namespace {

struct HasFolder {
    const MemoryFolder folder;
    std::string file() const { return folder.path("run.ugtrace"); }
    std::vector<RunRecord> read(RunKind kind) const {
        const auto run = trace::read_run(file());
        REQUIRE(run);
        CHECK(run->warnings.empty());
        std::vector<RunRecord> found;
        for (const RunRecord& record : run->records)
            if (record.kind == kind) found.push_back(record);
        return found;
    }
};

struct RecordedGates : HasFolder, GatesFixture {
    explicit RecordedGates(config::Dispatch opens_by = config::Dispatch::kHost)
        : GatesFixture(opens_by, config::DeviceDispatch::kArmed, {file(), 128, ""}) {}
    runtime::GateKeeper& keeper() { return common().gate_keeper; }
};

}  // namespace

TEST_CASE("Park is recorded with its time, the tasks that had gates, and launches that waited",
          "[runtime][gates][records]") {
    RecordedGates f;
    f.launch_on(f.thread_b, kStreamB);
    REQUIRE(f.is_closed());
    const auto begin = f.clock.now();
    f.keeper().park();
    f.clock.advance(50us);
    f.keeper().park();  // another call, which begins and ends meanwhile
    f.keeper().unpark();
    CHECK(f.read(RunKind::kPark).empty());
    f.launch_on(f.thread_b, kStreamB);
    CHECK(f.clock.num_sleeps > 0);
    const auto end = f.clock.now();
    f.keeper().unpark();
    const auto parks = f.read(RunKind::kPark);
    REQUIRE(parks.size() == 1);
    CHECK(parks[0].begin_ns == begin.count());
    CHECK(parks[0].time_ns == end.count());
    CHECK(parks[0].park.gated == 1);
    CHECK(parks[0].park.refused == 1);
    const observe::GateStatistics counts = f.keeper().counts();
    CHECK(counts.parks == 1);
    CHECK(counts.most_parked_us == 1e-3 * static_cast<double>((end - begin).count()));
    CHECK(counts.parked_us == counts.most_parked_us);
}

TEST_CASE("Park is recorded if it only keeps a launch in its thread, and not if it does nothing",
          "[runtime][gates][records]") {
    RecordedGates f;
    for (int i = 0; i < 3; ++i) {
        f.keeper().park();
        f.clock.advance(10us);
        f.keeper().unpark();
    }
    CHECK(f.read(RunKind::kPark).empty());
    f.keeper().park();
    f.launch_on(f.thread_b, kStreamB);
    f.keeper().unpark();
    const auto parks = f.read(RunKind::kPark);
    REQUIRE(parks.size() == 1);
    CHECK(parks[0].park.gated == 0);
    CHECK(parks[0].park.refused == 1);
    CHECK(parks[0].park.opening_ns == 0);
    CHECK(f.keeper().counts().parks == 0);  // it has opened none
}

TEST_CASE("Round of the host is recorded if it opens gates, with how many",
          "[runtime][gates][records]") {
    RecordedGates f;
    for (int i = 0; i < 6; ++i) f.launch_on(f.thread_b, kStreamB);
    REQUIRE(f.slot().gates_closed == 3);
    for (int i = 0; i < 5; ++i) {
        f.clock.advance(100us);
        f.poller.look();
    }
    CHECK(f.read(RunKind::kRound).empty());
    f.tight_ends();
    f.clock.advance(3ms);
    f.poller.look();
    const std::uint32_t opened = f.slot().gates_opened;
    REQUIRE(opened > 0);
    const auto rounds = f.read(RunKind::kRound);
    REQUIRE(rounds.size() == 1);
    CHECK(rounds[0].flags == 0);
    CHECK(rounds[0].time_ns == f.clock.now().count());
    CHECK(rounds[0].begin_ns == rounds[0].time_ns);  // virtual time
    CHECK(rounds[0].round.opened == opened);
    CHECK(rounds[0].round.rounds == 1);
    const observe::GateStatistics counts = f.keeper().counts();
    CHECK(counts.host_rounds == 1);
    CHECK(counts.opened_by_host == opened);
}

TEST_CASE("What opens by its time, or before a call that waits for all, is no round's",
          "[runtime][gates][records]") {
    RecordedGates f;
    f.launch_on(f.thread_b, kStreamB);
    REQUIRE(f.is_closed());
    SECTION("by its time") {
        f.clock.advance(nanoseconds(f.slot().gate_by_ns) - f.clock.now() + 1ms);
        f.poller.look();
    }
    SECTION("a call") {
        f.keeper().park();
        f.poller.look();
    }
    REQUIRE_FALSE(f.is_closed());
    CHECK(f.read(RunKind::kRound).empty());
    CHECK(f.keeper().counts().host_rounds == 0);
}

TEST_CASE("A gate that another thread or the GPU opens beside a round is not the round's",
          "[runtime][gates][records]") {
    abi::TaskSlot mine{}, other{}, again{};
    for (abi::TaskSlot* slot : {&mine, &other, &again}) {
        slot->gates_opened = 4;
        slot->gates_closed = 7;
    }
    runtime::GateEvents::Round round(50ns);
    for (const abi::TaskSlot* slot : {&mine, &other, &again}) round.note(*slot);
    sched::open_gate(mine, 6, 50ns);
    sched::open_gate(other, 7, 51ns);
    again.gates_opened = 3;  // by a store of the GPU's
    again.gate_opened_ns = 50;
    CHECK(round.opened() == 2);
}

TEST_CASE("Of the GPU's rounds that opened gates a look tells how many there were since the last",
          "[runtime][gates][records]") {
    RecordedGates f(config::Dispatch::kDevice);
    f.launch_on(f.thread_b, kStreamB);
    abi::DispatchSettings& page = f.common().page().dispatch;
    f.poller.look();
    CHECK(f.read(RunKind::kRound).empty());
    const auto before = f.clock.now();
    page.gpu_rounds = 3;  // that open none
    f.clock.advance(10us);
    f.poller.look();
    CHECK(f.read(RunKind::kRound).empty());
    f.slot().gates_opened_by_gpu = 2;
    page.gpu_rounds = 8;
    page.gpu_round_us = 40;
    f.clock.advance(10us);
    f.poller.look();
    f.poller.look();
    auto rounds = f.read(RunKind::kRound);
    REQUIRE(rounds.size() == 1);
    CHECK(rounds[0].flags == abi::kRunByGpu);
    CHECK(rounds[0].begin_ns == (before + 10us).count());
    CHECK(rounds[0].time_ns == (before + 20us).count());
    CHECK(rounds[0].round.opened == 2);
    CHECK(rounds[0].round.rounds == 8);
    CHECK(rounds[0].round.took_ns == 40'000);
}

TEST_CASE("Counts of the GPU's rounds may wrap between two looks", "[runtime][gates][records]") {
    RecordedGates f(config::Dispatch::kDevice);
    f.launch_on(f.thread_b, kStreamB);
    abi::DispatchSettings& page = f.common().page().dispatch;
    f.slot().gates_opened_by_gpu = 0xffff'ffff;
    page.gpu_rounds = 0xffff'fffe;
    page.gpu_round_us = 0xffff'ffff;  // has 64 bits
    f.poller.look();
    f.slot().gates_opened_by_gpu = 1;
    page.gpu_rounds = 3;
    page.gpu_round_us = 0x1'0000'0004;
    f.poller.look();
    const auto rounds = f.read(RunKind::kRound);
    REQUIRE(rounds.size() == 2);
    CHECK(rounds[1].round.opened == 2);
    CHECK(rounds[1].round.rounds == 5);
    CHECK(rounds[1].round.took_ns == 5'000);
}

namespace {

/// Others come between what a thread does and when it did.
struct YieldingClock final : Clock {
    nanoseconds now() override {
        std::this_thread::yield();
        return monotonic_now();
    }
    void sleep_for(nanoseconds) override {}
};

}  // namespace

TEST_CASE("Parks of several threads are recorded one after the other, each whole",
          "[runtime][gates][records][threads]") {
    constexpr int kThreads = 4, kCalls = 3000;
    const HasFolder at;
    CommonFixture f;
    runtime::Common& common = f.common();
    runtime::RunRecords records({at.file(), 128, ""}, {}, common.status, f.resolved.config);
    YieldingClock clock;
    runtime::GateEvents events(common.page(), common.roster, records, clock);
    std::atomic<std::uint32_t>& parked = common.page().dispatch.parked;
    std::atomic<int> firsts{0}, lasts{0};
    std::vector<std::thread> threads;
    for (int t = 0; t < kThreads; ++t)
        threads.emplace_back([&] {
            for (int i = 0; i < kCalls; ++i) {
                if (parked.fetch_add(1) == 0) {
                    events.park_begins({.begin = clock.now(), .has_gates = true, .gated = 1});
                    ++firsts;
                }
                lasts += events.park_ends();
            }
        });
    for (std::thread& thread : threads) thread.join();
    CHECK(parked == 0);
    CHECK(firsts == lasts);
    const auto parks = at.read(RunKind::kPark);
    CHECK(parks.size() == static_cast<std::size_t>(lasts));
    std::int64_t before_ns = 0;
    for (const RunRecord& park : parks) {
        CHECK(park.begin_ns >= before_ns);
        before_ns = park.time_ns;
    }
}
