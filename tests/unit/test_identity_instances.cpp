// SPDX-License-Identifier: Apache-2.0
//
// Frames on their way through chains, without a runtime.
#include "host/identity/instances.h"
#include "host/identity/last_wait.h"
#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using identity::ChainState;
using identity::Instances;
using identity::LastWait;

namespace {

struct IdentityInstancesTest {
    IdentityInstancesTest() {
        for (std::size_t i = 0; i < 2; ++i) {
            chains[i].index = i;
            chains[i].config.period = chains[i].config.deadline = 100ms;
            chains[i].tasks = {0, 1, 2};
            instances.add_chain(chains[i]);
        }
    }
    /// Each of them was told of.
    std::uint64_t missed(std::size_t chain) {
        CHECK(chains[chain].statistics.frames.missed == told[chain]);
        return told[chain];
    }

    ChainState chains[2];
    std::uint64_t told[2] = {};
    // It calls as it is told, which no lock must stand in the way of.
    Instances instances{[this](const ChainState& chain) {
        ++told[chain.index];
        instances.find(0);
    }};
};

}  // namespace

TEST_CASE("Instances finds frames by their tokens, each in its chain", "[identity][instances]") {
    IdentityInstancesTest f;
    const auto a = f.instances.arrived(0, 1ms), b = f.instances.arrived(1, 2ms);
    CHECK(a != b);
    CHECK(f.instances.find(a).chain == &f.chains[0]);
    CHECK(f.instances.find(b).chain == &f.chains[1]);
    CHECK(f.instances.find(b).arrival == 2ms);
    f.instances.forget(a);
    CHECK(f.instances.find(a).token == 0);
    CHECK(f.instances.find(0).token == 0);
    CHECK(f.instances.find(b).token == b);
}

TEST_CASE("Instances counts frames that never end as missed", "[identity][instances]") {
    IdentityInstancesTest f;
    const auto first = f.instances.arrived(0, 0ms);
    SECTION("when there are too many of the chain") {
        const auto other = f.instances.arrived(1, 0ms);
        for (std::size_t i = 1; i < identity::InstanceRing::kSize; ++i) f.instances.arrived(0, 0ms);
        CHECK(f.missed(0) == 0);
        f.instances.arrived(0, 0ms);
        CHECK(f.missed(0) == 1);
        CHECK(f.missed(1) == 0);
        CHECK(f.instances.find(other).token == other);
    }
    SECTION("when their deadline has passed at the end") {
        f.instances.drop_late(100ms);
        CHECK(f.missed(0) == 0);
        f.instances.drop_late(101ms);
        CHECK(f.missed(0) == 1);
    }
    CHECK(f.instances.find(first).token == 0);
}

TEST_CASE("Instances hands frames on in order", "[identity][instances]") {
    IdentityInstancesTest f;
    Instances& i = f.instances;
    CHECK_FALSE(i.taken_over(0, 0, {}));
    i.entered(0, 0, 1ms);
    CHECK_FALSE(i.taken_over(0, 1, {}));  // still at the first task
    i.handed_on(0, 0, 1ms, 2ms);
    i.entered(0, 0, 3ms);
    i.handed_on(0, 0, 3ms, 4ms);
    CHECK_FALSE(i.taken_over(1, 1, {}));  // of another chain
    CHECK(i.taken_over(0, 1, {}) == 1ms);
    CHECK(i.taken_over(0, 1, {}) == 3ms);
    CHECK_FALSE(i.taken_over(0, 1, {}));
    i.handed_on(0, 1, 3ms, 5ms);
    CHECK(i.taken_over(0, 2, {}) == 3ms);
    i.handed_on(0, 2, 3ms, 6ms);  // the chain's last: the frame is gone
    i.handed_on(0, 2, 3ms, 6ms);
    CHECK(f.missed(0) == 0);
}

TEST_CASE("Instances skips frames that a thread with nothing to do left lying",
          "[identity][instances]") {
    IdentityInstancesTest f;
    for (const auto arrival : {1ms, 2ms, 3ms}) {
        f.instances.entered(0, 0, arrival);
        f.instances.handed_on(0, 0, arrival, arrival + 1ms);
    }
    // The newest is taken in any case.
    SECTION("all but the newest") {
        CHECK(f.instances.taken_over(0, 1, 100ms) == 3ms);
    }
    SECTION("what was finished before it slept") {
        CHECK(f.instances.taken_over(0, 1, 3ms) == 2ms);
        CHECK(f.missed(0) == 1);
    }
    SECTION("none if it was busy") {
        CHECK(f.instances.taken_over(0, 1, {}) == 1ms);
        CHECK(f.missed(0) == 0);
    }
}

TEST_CASE("Instances forgets frames without hints that never come to their end",
          "[identity][instances]") {
    IdentityInstancesTest f;
    f.instances.entered(0, 0, 1ms);
    f.instances.entered(0, 0, 801ms);
    CHECK(f.missed(0) == 0);
    f.instances.entered(0, 0, 802ms);
    CHECK(f.missed(0) == 1);
}

TEST_CASE("Instances forgets frames on their way when it is told to", "[identity][instances]") {
    IdentityInstancesTest f;
    f.instances.entered(0, 0, 1ms);
    f.instances.handed_on(0, 0, 1ms, 2ms);
    f.instances.entered(0, 0, 3ms);
    const auto hinted = f.instances.arrived(0, 3ms);
    f.instances.forget_passages();
    f.instances.handed_on(0, 0, 3ms, 4ms);  // its thread did not know yet
    CHECK_FALSE(f.instances.taken_over(0, 1, {}));
    f.instances.entered(0, 0, 802ms);
    CHECK(f.missed(0) == 0);
    CHECK(f.instances.find(hinted).token == hinted);
}

TEST_CASE("ChainState counts what became of a frame", "[identity]") {
    IdentityInstancesTest f;
    ChainState& chain = f.chains[0];
    chain.finished(0ms, 150ms);
    chain.finished(100ms, 260ms);
    CHECK(chain.statistics.frames.missed == 2);
    CHECK(chain.statistics.frames.most_misses_in_a_row == 2);
    CHECK(chain.statistics.frames.most_late_ns == (60ms / 1ns));
    chain.finished(200ms, 300ms);
    chain.exited(300ms, 310ms);
    CHECK(chain.statistics.frames.finished == 4);
    CHECK(chain.statistics.frames.exited == 1);
    CHECK(chain.statistics.frames.missed == 3);
    CHECK(chain.misses_in_a_row == 1);
}

namespace {

nanoseconds arrival(LastWait& wait, const sched::GovernedChain& chain, nanoseconds now) {
    return wait.begin_frame(chain, wait.computed(chain, now), now);
}

}  // namespace

TEST_CASE("LastWait takes a frame to have come when the thread began to work for it",
          "[identity][last_wait]") {
    sched::GovernedChain chain;
    chain.config.period = chain.config.deadline = 100ms;
    LastWait wait;
    CHECK(arrival(wait, chain, 5s) == 5s);  // nothing is known
    wait.ended(5s);
    // Little time has passed: it makes no difference what the thread did in it.
    CHECK(arrival(wait, chain, 5s + 400us) == 5s);
    CHECK_FALSE(wait.has_slept(wait.computed(chain, 5s + 400us), 5s + 400us));
    // The thread has taken hardly any CPU time since: it slept.
    CHECK(wait.has_slept(wait.computed(chain, 6s), 6s));
    CHECK(arrival(wait, chain, 6s) > 5s + 900ms);
}

TEST_CASE("LastWait takes a thread that is behind to be late for a frame that was due",
          "[identity][last_wait]") {
    sched::GovernedChain chain;
    chain.config.period = chain.config.deadline = 100ms;
    LastWait wait;
    chain.last_arrival_ns = (4850ms / 1ns);
    wait.ended(5s);
    CHECK(arrival(wait, chain, 5s + 100us) == 4950ms);
    chain.last_arrival_ns = (4920ms / 1ns);  // the next one is not due yet
    CHECK(arrival(wait, chain, 5s + 100us) == 5s);
    chain.last_arrival_ns = (1s / 1ns);  // by two periods at most
    CHECK(arrival(wait, chain, 5s + 100us) == 4800ms + 100us);
}
