// SPDX-License-Identifier: Apache-2.0
//
// Chains that need more than a GPU has, one after the other.
#include "host/sched/admission.h"
#include "host/sched/policies/feasible.h"
#include "tests/support/catch.h"
#include "tests/support/governor_fixture.h"
#include "tests/support/slot_views.h"

using namespace urgengo;
using namespace urgengo::testing;
using namespace std::chrono_literals;
using sched::Load;

TEST_CASE("Chains have to share that can all be met side by side only", "[sched][load]") {
    CHECK(Load{.gpu = 1.1, .shared = 0.87}.has_to_share());
    CHECK_FALSE(Load{.gpu = 0.9, .shared = 0.7}.has_to_share());    // there is time for all
    CHECK_FALSE(Load{.gpu = 1.3, .shared = 1}.has_to_share());      // not so, either
    CHECK_FALSE(Load{.gpu = 1.03, .shared = 0.93}.has_to_share());  // as they are next to alone
    CHECK_FALSE(Load{.launching = 2}.has_to_share());
}

TEST_CASE("Launching is scarce where a chain launches for most of its period", "[sched][load]") {
    CHECK(Load{.contended = 0.75}.launching_is_scarce());
    CHECK_FALSE(Load{.contended = 0.65}.launching_is_scarce());
    CHECK_FALSE(Load{.gpu = 2, .shared = 2, .launching = 2}.launching_is_scarce());
}

TEST_CASE("Who has to share is hardly held for room", "[sched][load]") {
    const std::vector tasks{job(0, 10ms, 8ms), job(1, 11ms, 8ms)};
    config::Packing packing;
    const auto limit = [&](const Load& load, bool others_need_all = false) {
        const sched::Plan plan = sched::make_plan(0ns, tasks, 0, packing.share_slack, load);
        return sched::to_utilization(limits_of(packing, plan).now(false, others_need_all));
    };
    CHECK(limit({.gpu = 1.1, .shared = 0.8}) == 2);
    CHECK(limit({.contended = 0.8}) == abi::kMaxTasks);
    CHECK(limit({.contended = 0.8}, true) == Approx(1.05));
    CHECK(limit({.gpu = 1.1, .shared = 1.1}) == Approx(1.05));
    CHECK(limit({.gpu = 1.1, .shared = 0.8}, true) == Approx(1.05));
    packing.share_limit = 3;
    CHECK(limit({.gpu = 1.1, .shared = 0.8}) == 3);
    packing.share_limit = 1;  // nobody may share
    CHECK(limit({.gpu = 1.1, .shared = 0.8}) == Approx(1.05));
}

TEST_CASE("What chains have to share is told to the GPU's dispatcher, and taken back",
          "[sched][load]") {
    config::Scheduler scheduler;
    scheduler.dispatch.where = config::Dispatch::kDevice;
    GovernorFixture f({10ms, 10ms}, scheduler);
    const abi::DispatchSettings& page = f.page->dispatch;
    const auto plan_with = [&](nanoseconds gpu_time) {
        for (int i = 0; i < 2; ++i) {
            f.slot(i).mean_utilization_ppm = 700'000;
            f.slot(i).chain_gpu_ns = gpu_time.count();
            f.task(i).estimated.gpu_ns = gpu_time.count();
        }
        f.governor.plan().reckon_load();
        f.now += 1ms;
        f.begin(0, 2ms, 0.7);
        f.begin(1, 2ms, 0.7);
        f.governor.plan().refresh(f.now += 100ms);
    };
    plan_with(6ms);  // 1.2 one after the other, 0.84 side by side
    CHECK(page.share_limit_ppm == 2'000'000);
    CHECK(nanoseconds(page.plan_slack_ns) == nanoseconds::max());
    plan_with(4ms);
    CHECK(page.share_limit_ppm == 1'600'000);
    CHECK(nanoseconds(page.plan_slack_ns) < 10ms);
}

namespace {

/// Two chains, of which the first launches for most of its period, slowed down by the other.
void make_scarce(GovernorFixture& f) {
    for (int i = 0; i < 2; ++i) {
        f.slot(i).chain_gpu_ns = nanoseconds(2ms).count();
        f.task(i).estimated.gpu_ns = nanoseconds(2ms).count();
    }
    f.task(0).estimated.idle_ns = nanoseconds(6ms).count();
    f.task(0).is_contended = true;
    f.now += 1ms;
    f.begin(1, 2ms, 0.7);
}

bool is_scarce(GovernorFixture& f) {
    f.governor.plan().refresh(f.now += 100ms);
    return f.governor.plan().launching_is_scarce();
}

}  // namespace

TEST_CASE("A chain that has stopped makes launching scarce no more", "[sched][load]") {
    GovernorFixture f({10ms, 10ms});
    make_scarce(f);
    CHECK_FALSE(is_scarce(f));
    f.begin(0, 2ms, 0.7);
    CHECK(is_scarce(f));
    f.slot(0).state = abi::TaskState::kIdle;
    CHECK_FALSE(is_scarce(f));
}

TEST_CASE("Where launching is scarce most marks are looks at who else launches", "[sched][load]") {
    GovernorFixture f({10ms, 10ms});
    make_scarce(f);
    f.begin(0, 2ms, 0.7);
    sched::GovernedTask& task = f.task(0);
    task.work.launched += 200us;
    CHECK_FALSE(f.governor.looks_instead_of_mark(task, f.now));
    CHECK(task.work.looked == 0us);
    REQUIRE(is_scarce(f));
    f.task(1).work.launched += 200us;  // it is bound by the GPU
    CHECK_FALSE(f.governor.looks_instead_of_mark(f.task(1), f.now));
    CHECK(f.governor.looks_instead_of_mark(task, f.now));
    CHECK(task.work.looked == 200us);
    CHECK(task.work.marked == 0us);
    CHECK(task.run.launching.marks == 1);
    task.work.launched += 800us;  // since the last mark
    CHECK_FALSE(f.governor.looks_instead_of_mark(task, f.now));
}

TEST_CASE("Marks that times are learned from, of each launch, or of a batch are not spared",
          "[sched][load]") {
    config::Scheduler scheduler;
    SECTION("learned from") {
        scheduler.progress.learn = true;
    }
    SECTION("at each launch") {
        scheduler.progress.mark_every = 0us;
    }
    SECTION("of a batch") {
        scheduler.progress.tracking = config::Tracking::kBatched;
    }
    GovernorFixture f({10ms, 10ms}, scheduler);
    make_scarce(f);
    f.begin(0, 2ms, 0.7);
    REQUIRE(is_scarce(f));
    f.task(0).work.launched += 200us;
    CHECK_FALSE(f.governor.looks_instead_of_mark(f.task(0), f.now));
}
