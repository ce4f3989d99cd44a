// SPDX-License-Identifier: Apache-2.0
//
// How fast a task launches beside others, of how it does alone (sched/estimates.h), in virtual
// time.
#include "host/sched/governor.h"
#include "tests/support/catch.h"
#include "tests/support/governor_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

/// Of a task that launches alone every 100 us what takes the GPU `gpu`.
struct LaunchSpeed {
    GovernorFixture its{{50ms, 100ms}};
    nanoseconds gpu;

    explicit LaunchSpeed(nanoseconds of_each = 40us) : gpu(of_each) {
        config::KernelProfile kernel;
        kernel.gpu_time = gpu;
        config::TaskProfile profile;
        for (int i = 0; i < 200; ++i) {
            kernel.launch_time = i * 100us;
            profile.kernels.push_back(kernel);
        }
        its.task(0).plan = model::TaskPlan(profile);
        begin_segment();
    }
    void begin_segment() {
        its.begin(0, 20ms);
        its.task(0).run.position = 0;
        its.governor.estimates().segment_begins(its.task(0), 0, its.now);
    }
    void launch_after(nanoseconds time) {
        its.now += time;
        its.launch(0, gpu);
        its.governor.estimates().sees_launchers(its.task(0), its.now);
    }
    int speed_pm() { return its.slot(0).launch_speed_pm; }
};

}  // namespace

TEST_CASE("A task's launching is as slow as it was since that was told last", "[sched][governor]") {
    LaunchSpeed f;
    f.launch_after(0us);
    f.launch_after(100us);
    CHECK(f.speed_pm() == 0);  // that is too short to tell
    f.launch_after(300us);
    CHECK(f.speed_pm() == 500);
    f.launch_after(400us);
    CHECK(f.speed_pm() == 250);
    for (int i = 0; i < 4; ++i) f.launch_after(100us);
    CHECK(f.speed_pm() == 1000);  // it has caught up
    SECTION("a segment does not know of the one before") {
        f.launch_after(400us);
        REQUIRE(f.speed_pm() == 250);
        f.begin_segment();
        CHECK(f.speed_pm() == 0);
    }
    SECTION("what it was held and paced is not its time") {
        f.its.task(0).run.waited.held += 1ms;
        f.its.task(0).run.waited.paced += 2ms;
        f.launch_after(3ms + 400us);
        f.launch_after(200us);
        CHECK(f.speed_pm() > 250);
        CHECK(f.speed_pm() < 1000);
    }
    SECTION("what it waited behind gates while it launched tells nothing") {
        f.its.task(0).run.waited.paced += 2ms;
        f.launch_after(400us);
        CHECK(f.speed_pm() == 0);
    }
}

TEST_CASE("Who launches as fast as the GPU executes is not slowed down by what the GPU does",
          "[sched][governor]") {
    LaunchSpeed f(400us);
    f.launch_after(0us);
    for (int i = 0; i < 4; ++i) f.launch_after(800us);
    CHECK(f.speed_pm() == 0);
}

TEST_CASE("Of a task whose times are not known nothing is said of its speed", "[sched][governor]") {
    LaunchSpeed f;
    const auto says = [&] {
        f.begin_segment();
        for (int i = 0; i < 4; ++i) f.launch_after(600us);
        return f.speed_pm() > 0;
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
