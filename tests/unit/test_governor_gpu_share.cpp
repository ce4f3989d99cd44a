// SPDX-License-Identifier: Apache-2.0
//
// How much of the GPU a task takes as it launches now (sched/estimates.h), in virtual time.
#include "host/sched/governor.h"
#include "tests/support/catch.h"
#include "tests/support/governor_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

struct GpuShare {
    GovernorFixture its{{50ms, 100ms}};

    GpuShare() {
        config::KernelProfile kernel;
        kernel.gpu_time = 100us;
        config::TaskProfile profile;
        profile.kernels.assign(200, kernel);
        its.task(0).plan = model::TaskPlan(profile);
        begin_segment();
    }
    void begin_segment() {
        its.begin(0, 20ms);
        its.governor.estimates().segment_begins(its.task(0), 0, its.now);
    }
    /// A launch of 100 us of GPU work, so long after the one before.
    void launch_after(nanoseconds time) {
        its.now += time;
        its.launch(0, 100us);
        its.governor.estimates().marked(its.task(0), its.now);
    }
    int share_pm() { return its.slot(0).gpu_share_pm; }
};

}  // namespace

TEST_CASE("What a task takes of the GPU is what it launches in its time", "[sched][governor]") {
    GpuShare f;
    f.launch_after(100us);
    CHECK(f.share_pm() == 0);  // that is too short to tell
    f.launch_after(300us);
    CHECK(f.share_pm() == 500);
    for (int i = 0; i < 6; ++i) f.launch_after(600us);
    CHECK(f.share_pm() == 200);
    SECTION("a segment does not know of the one before") {
        f.begin_segment();
        CHECK(f.share_pm() == 0);
    }
    SECTION("what it was held and paced is not its time") {
        f.its.task(0).run.waited.held += 1ms;
        f.its.task(0).run.waited.paced += 2ms;
        f.launch_after(3ms);
        CHECK(f.share_pm() == 225);  // 0.9 of 4 ms
    }
    SECTION("it is of true times") {
        f.its.slot(0).factor_ppm = 500'000;
        f.launch_after(500us);
        CHECK(f.share_pm() == 100);  // half of 0.9 of 4.5 ms
    }
    SECTION("who launches faster than the GPU executes takes all of it") {
        for (int i = 0; i < 100; ++i) f.launch_after(5us);
        CHECK(f.share_pm() == 1000);
    }
}

TEST_CASE("Of a task whose times are not known nothing is said of its share", "[sched][governor]") {
    GpuShare f;
    const auto says = [&] {
        f.begin_segment();
        for (int i = 0; i < 4; ++i) f.launch_after(600us);
        return f.share_pm() > 0;
    };
    REQUIRE(says());
    SECTION("it learns") {
        f.its.task(0).record.learns = true;
    }
    SECTION("no profile has it") {
        f.its.task(0).plan = {};
    }
    CHECK_FALSE(says());
}
