// SPDX-License-Identifier: Apache-2.0
//
// The bound on misses: reckoned by hand, and below what every scheduler has.
#include "tests/support/catch.h"
#include "tools/chains/spec.h"
#include "tools/sim/least_misses.h"
#include "tools/sim/workloads.h"
#include "tools/sim/world.h"

using namespace urgengo;
using namespace urgengo::sim;

namespace {

/// Equal chains of one kernel of 10 ms that fills the GPU.
chains::Workload full_kernels(int num_chains, double deadline_ms) {
    const GpuShape shape;
    chains::Kernel kernel;
    kernel.block = 256;
    kernel.grid = shape.num_sms * shape.threads_per_sm / 256;
    kernel.est_us = 10'000 + double(shape.gap.count()) / 1000;
    chains::Workload workload;
    workload.num_sms = shape.num_sms;
    for (int i = 0; i < num_chains; ++i) {
        chains::Chain chain;
        chain.period_ms = 1000;
        chain.deadline_ms = deadline_ms;
        chain.tasks.push_back({"t", 0, 10, 1, 1, {kernel}});
        chain.place = 0;  // all arrive at the same time
        workload.chains.push_back(chain);
    }
    return workload;
}

}  // namespace

TEST_CASE("Of frames that arrive together as many are lost as have no room", "[unit][sim]") {
    // Three of 10 ms in 25: one is too many. In 19 ms: two. In 9 ms: all.
    const auto roomy = least_misses(full_kernels(3, 25), {}, 5, 1);
    CHECK(roomy.one_at_a_time == Approx(1.0 / 3));
    CHECK(roomy.shared == Approx(roomy.one_at_a_time));
    CHECK(least_misses(full_kernels(3, 19), {}, 5, 1).one_at_a_time == Approx(2.0 / 3));
    CHECK(least_misses(full_kernels(3, 9), {}, 5, 1).one_at_a_time == Approx(1));
    CHECK(least_misses(full_kernels(3, 31), {}, 5, 1).one_at_a_time == 0);
}

TEST_CASE("No preset misses less than the least", "[unit][sim]") {
    const chains::Workload workload = h200_ten_chains();
    WorldSettings settings;
    settings.seconds = 8;
    settings.scenario.tight = chains::tight_chains(0.4);
    for (const double f_a : {0.9, 1.3, 1.6}) {
        settings.scenario.f_a = f_a;
        const LeastMisses least = least_misses(workload, settings.scenario, 8, 1);
        INFO("f_a " << f_a);
        CHECK(least.shared <= least.one_at_a_time);
        CHECK((f_a < 1.2 || least.one_at_a_time > 0.02));
        for (const char* row : {"urgengo", "edf", "bare"}) {
            const auto subject = make_subject(row, workload, settings.scenario);
            REQUIRE(subject);
            CHECK(World(workload, **subject, settings).run().overall_miss_ratio() >= least.shared);
        }
    }
}
