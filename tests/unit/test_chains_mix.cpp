// SPDX-License-Identifier: Apache-2.0
//
// The paper's table, and the kernels that tasks are made of.
#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <set>

#include "tests/support/catch.h"
#include "tools/chains/checksum.h"
#include "tools/chains/kernel_mix.h"
#include "tools/chains/spec.h"

using namespace urgengo::chains;

namespace {

constexpr IterationCost kCost{0.02, 1.2};

double estimate_ms(const Task& task) {
    return std::accumulate(task.kernels.begin(), task.kernels.end(), 0.0,
                           [](double sum, const Kernel& kernel) { return sum + kernel.est_us; }) /
           1000;
}

Task sample_task(const MixSettings& settings, int num_sms = 132) {
    return build_task({"detect2d", 323, 19.8}, 10, task_seed(settings.seed, 2, 0), settings, kCost,
                      num_sms);
}

}  // namespace

TEST_CASE("paper_chains has the totals of the paper's table 2", "[unit][chains]") {
    const double gpu_ms[] = {28.4, 28.4, 27.0, 30.2, 19.5, 30.2, 19.5, 27.0, 19.7, 46.1};
    const auto& chains = paper_chains();
    REQUIRE(chains.size() == 10);
    for (std::size_t i = 0; i < chains.size(); i++) {
        double sum_ms = 0;
        for (const TaskSpec& task : chains[i].tasks) sum_ms += task.gpu_ms;
        CAPTURE(i);
        CHECK(chains[i].name == "C" + std::to_string(i));
        // The paper rounds: detect2d and face make 26.9.
        CHECK(sum_ms == Approx(gpu_ms[i]).margin(0.11));
        CHECK(chains[i].deadline_ms == 120);
    }
}

TEST_CASE("paper_chains has the input sizes of the paper's table 3", "[unit][chains]") {
    std::set<std::string> varying;
    for (const ChainSpec& chain : paper_chains()) {
        for (const TaskSpec& task : chain.tasks) {
            if (task.min_inputs != task.max_inputs) varying.insert(task.name);
        }
    }
    CHECK(varying == std::set<std::string>{"detect3d", "icp", "path", "track"});
    const TaskSpec& icp = paper_chains()[8].tasks[0];
    CHECK(icp.min_inputs == 22000);
    CHECK(icp.max_inputs == 65000);
}

TEST_CASE("tight_chains follows its documented order", "[unit][chains]") {
    using Names = std::vector<std::string>;
    CHECK(tight_chains(0.4) == Names{"C0", "C3", "C6", "C8"});
    CHECK(tight_chains(0).empty());
    CHECK(tight_chains(0.3) == Names{"C0", "C3", "C6"});
    CHECK(tight_chains(0.5) == Names{"C0", "C3", "C6", "C8", "C1"});
    CHECK(tight_chains(1).size() == 10);
    CHECK(tight_chains(1).back() == "C9");
}

TEST_CASE("task_seed gives the published mix when the seed is the default", "[unit][chains]") {
    CHECK(task_seed(7, 0, 0) == 100);
    CHECK(task_seed(7, 9, 0) == 190);
    CHECK(task_seed(7, 3, 1) == 131);
    CHECK(task_seed(8, 0, 0) != task_seed(7, 9, 1));
}

TEST_CASE("build_task makes as many kernels as the paper, of its total time", "[unit][chains]") {
    const Task task = sample_task({});
    CHECK(task.kernels.size() == 323);
    CHECK(task.max_inputs == 1);
    CHECK(estimate_ms(task) >= 19.8);  // short kernels are lengthened to 4 us
    CHECK(estimate_ms(task) < 19.8 * 1.02);
    for (const Kernel& kernel : task.kernels) {
        REQUIRE(kernel.kind == KernelKind::kCompute);
        REQUIRE(kernel.block == 256);
        REQUIRE(kernel.est_us >= 4);
        REQUIRE(kernel.utilization >= 0.3);
        REQUIRE(kernel.utilization <= 1.0);
        const int waves = std::max(1, int(std::round(kernel.est_us / 60)));
        REQUIRE(kernel.grid == int(kernel.utilization * 132 * 4) * waves);
        REQUIRE(kernel.iterations == Approx(kernel.est_us / waves / 0.02).margin(1));
    }
}

TEST_CASE("build_task takes over the range of inputs", "[unit][chains]") {
    const TaskSpec spec{"icp", 40, 11.7, 22000, 65000};
    const Task task = build_task(spec, 10, 1, {}, kCost, 132);
    CHECK(task.min_inputs == 22000);
    CHECK(task.max_inputs == 65000);
}

TEST_CASE("build_task draws all weights, then all utilisations, whatever the memory share",
          "[unit][chains]") {
    MixSettings settings;
    settings.memory_share = GENERATE(0.0, 0.5);
    const Task task = sample_task(settings);
    std::mt19937 random(120);  // C2's first task
    std::lognormal_distribution<double> any_weight(0, 0.8);
    std::uniform_real_distribution<double> any_utilization(0.3, 1.0);
    for (std::size_t i = 0; i < task.kernels.size(); i++) any_weight(random);
    for (const Kernel& kernel : task.kernels) {
        REQUIRE(kernel.utilization == any_utilization(random));
    }
}

TEST_CASE("build_task keeps sizes and changes grids when the GPU is another", "[unit][chains]") {
    const Task large = sample_task({}, 132), small = sample_task({}, 1);
    REQUIRE(large.kernels.size() == small.kernels.size());
    for (std::size_t i = 0; i < large.kernels.size(); i++) {
        REQUIRE(large.kernels[i].est_us == small.kernels[i].est_us);
        REQUIRE(large.kernels[i].utilization == small.kernels[i].utilization);
        REQUIRE(small.kernels[i].grid >= 1);
    }
}

TEST_CASE("build_task mixes in memory kernels when asked", "[unit][chains]") {
    MixSettings settings;
    settings.memory_share = 0.5;
    const Task task = sample_task(settings);
    const auto num_memory =
        std::count_if(task.kernels.begin(), task.kernels.end(),
                      [](const Kernel& kernel) { return kernel.kind == KernelKind::kMemory; });
    CHECK(num_memory > 120);
    CHECK(num_memory < 200);
}

TEST_CASE("scale_iterations scales every kernel and keeps one iteration", "[unit][chains]") {
    Task task = sample_task({});
    task.kernels[0].iterations = 1000;
    task.kernels[1].iterations = 1;
    scale_iterations(task, 0.25);
    CHECK(task.kernels[0].iterations == 250);
    CHECK(task.kernels[1].iterations == 1);
}

TEST_CASE("set_isolated_ms makes the estimates add up to the measured time", "[unit][chains]") {
    Task task = sample_task({});
    const double ratio = task.kernels[5].est_us / task.kernels[6].est_us;
    set_isolated_ms(task, 20.1);
    CHECK(task.isolated_ms == 20.1);
    CHECK(estimate_ms(task) == Approx(20.1));
    CHECK(task.kernels[5].est_us / task.kernels[6].est_us == Approx(ratio));
}

TEST_CASE("BlockValues repeats the kernels' arithmetic", "[unit][chains]") {
    Task task;
    task.kernels = {{KernelKind::kCompute, 3, 256, 1, 1, 1},
                    {KernelKind::kMemory, 2, 256, 5, 1, 1}};
    Workload workload;
    workload.chains = {{"C0", 1, 1, {task}}};
    const BlockValues values(workload);
    // One iteration turns 0, 1, 2, 3 into x * 1.000001f + 1e-7f, rounded once each; then their sum,
    // 6.0000057, from exact arithmetic with rounding to float.
    const std::uint64_t computed = 0x40C0000C, five_ones_four_times = 0x41A00000;
    CHECK(values.task_sum(task, 1) == 3 * computed + 2 * five_ones_four_times);
    CHECK(values.task_sum(task, 1.5) == 5 * computed + 3 * five_ones_four_times);
}
