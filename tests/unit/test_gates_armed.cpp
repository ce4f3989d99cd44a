// SPDX-License-Identifier: Apache-2.0
//
// Gates whose dispatcher on the GPU is armed: when arms wait, and what opens gates without them.
#include "tests/support/gates_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

/// Behind its one gate `loose` waits, and arms do.
struct ArmedFixture : GatesFixture {
    explicit ArmedFixture(CUresult of_arms = CUDA_SUCCESS)
        : GatesFixture(config::Dispatch::kDevice, config::DeviceDispatch::kArmed) {
        arms_result = of_arms;
        launch_on(thread_b, kStreamB);
        REQUIRE(closed.size() == 1);
        REQUIRE(is_closed());
        CHECK(clock.num_sleeps == 0);
    }
};

}  // namespace

TEST_CASE("A closed gate has arms put ahead, and a thread of ours puts more",
          "[runtime][gates][arms]") {
    ArmedFixture f;
    CHECK(GatesFixture::num_waiting_arms() == 3);
    CHECK(f.leases.num_wakes == 1);
    CHECK(f.leases.look() == exec::More::kLater);
    CHECK(GatesFixture::num_waiting_arms() == exec::Arms::kFewest);
    CHECK(f.poller.look() == exec::More::kLater);
}

TEST_CASE("Without an arm that is woken the host's rounds open gates, in time and by bound",
          "[runtime][gates][arms]") {
    const bool is_refused = GENERATE(true, false);
    ArmedFixture f(is_refused ? CUDA_ERROR_NOT_SUPPORTED : CUDA_SUCCESS);
    f.leases.look();
    CHECK((GatesFixture::num_waiting_arms() == 0) == is_refused);
    SECTION("what was more urgent has executed") {
        f.poller.look();
        CHECK(f.is_closed());
        f.tight_ends();
        f.clock.advance(3ms);
        f.poller.look();
    }
    SECTION("its bound is over") {
        f.clock.advance(201ms);  // two deadlines
        f.poller.look();
    }
    CHECK_FALSE(f.is_closed());
}

TEST_CASE("No arm waits while a call is under way that waits for all work",
          "[runtime][gates][arms]") {
    ArmedFixture f;
    REQUIRE(GatesFixture::num_waiting_arms() > 0);
    f.common().gate_keeper.park();
    CHECK(GatesFixture::num_waiting_arms() == 0);
    CHECK_FALSE(f.is_closed());
    const std::size_t before = GatesFixture::arms.size();
    f.leases.look();
    CHECK(GatesFixture::arms.size() == before);
    f.common().gate_keeper.unpark();
    f.leases.look();
    CHECK(GatesFixture::arms.size() > before);
}

TEST_CASE("No arm waits once no gate has been closed for as long as a lease",
          "[runtime][gates][arms]") {
    ArmedFixture f;
    f.tight_ends();
    f.clock.advance(3ms);
    CHECK(f.poller.look() == exec::More::kLater);  // until they have ended
    REQUIRE_FALSE(f.is_closed());
    f.launch_on(f.thread_b, kStreamB);
    REQUIRE(f.loose().gates.is_open);
    const std::size_t before = GatesFixture::arms.size();
    f.clock.advance(f.resolved.config.scheduler.dispatch.lease);
    CHECK(f.poller.look() == exec::More::kLater);
    CHECK(GatesFixture::num_waiting_arms() == 0);
    CHECK(f.leases.look() == exec::More::kNone);
    CHECK(GatesFixture::arms.size() == before);
}

TEST_CASE("No arm waits once UrgenGo has switched itself off, or is switched off",
          "[runtime][gates][arms]") {
    ArmedFixture f;
    SECTION("it has") {
        f.common().gate_keeper.trip();
        CHECK(GatesFixture::num_waiting_arms() == 0);
    }
    SECTION("it is") {
        f.common().governor.steered().set(config::Mode::kOff);
        CHECK(f.poller.look() == exec::More::kLater);
        f.clock.advance(f.resolved.config.scheduler.dispatch.lease);
        CHECK(f.poller.look() == exec::More::kLater);
        CHECK(GatesFixture::num_waiting_arms() == 0);
    }
    SECTION("the program exits") {
        f.poller.stopped = true;
        f.poller.stop();
        CHECK(GatesFixture::num_waiting_arms() == 0);
    }
    const std::size_t before = GatesFixture::arms.size();
    f.leases.look();
    CHECK(GatesFixture::arms.size() == before);
}
