// SPDX-License-Identifier: Apache-2.0
//
// Tasks over several streams, forked and joined by events, in virtual time.
#include <vector>

#include "host/config/presets.h"
#include "tests/support/catch.h"
#include "tools/sim/branch_times.h"
#include "tools/sim/governed_subject.h"
#include "tools/sim/profiled.h"
#include "tools/sim/recorded.h"
#include "tools/sim/world.h"

using namespace urgengo;
using namespace urgengo::sim;
using namespace std::chrono_literals;

namespace {

constexpr double kGapUs = 1.5;

/// @param blocks  few: branches fit beside each other
chains::Kernel kernel(double us, int blocks = 24) {
    chains::Kernel its;
    its.block = 256;
    its.grid = blocks;
    its.est_us = us + kGapUs;
    its.utilization = blocks / 528.0;
    return its;
}

struct Forked {
    chains::Task task;
    TaskTraits traits;

    void launch(double us, int branch, std::vector<int> after = {}, int blocks = 24) {
        task.kernels.push_back(kernel(us, blocks));
        task.isolated_ms += us / 1000;
        traits.launches.push_back({0ns, branch, std::move(after)});
    }
};

/// As many kernels of 100 us on the first stream; 400 us on the second beside 100 and 200 on the
/// third; 50 behind all of them.
Forked diamond(int before = 1, int blocks = 24) {
    Forked its;
    its.task.name = "forked";
    its.task.cpu_ms = 0.5;
    for (int i = 0; i < before; ++i) its.launch(100, 0, {}, blocks);
    its.launch(400, 1, {0}, blocks);
    its.launch(100, 2, {0}, blocks);
    its.launch(200, 2, {}, blocks);
    its.launch(50, 0, {1, 2}, blocks);
    return its;
}

chains::Task line(double us, int kernels, int blocks) {
    chains::Task task;
    task.name = "line";
    task.cpu_ms = 0.5;
    for (int i = 0; i < kernels; ++i) {
        task.kernels.push_back(kernel(us, blocks));
        task.isolated_ms += (us + kGapUs) / 1000;
    }
    return task;
}

struct Program {
    chains::Workload workload;
    WorldSettings settings;

    void add(double period_ms, double deadline_ms, const chains::Task& task,
             const TaskTraits& traits = {}) {
        chains::Chain chain;
        chain.place = workload.chains.size();
        chain.name = "c" + std::to_string(chain.place);
        chain.period_ms = period_ms;
        chain.deadline_ms = deadline_ms;
        chain.tasks = {task};
        workload.num_sms = GpuShape{}.num_sms;
        workload.chains.push_back(chain);
        settings.traits.emplace_back();
        settings.traits.back().tasks = {traits};
    }
    chains::RunReport run(bool is_governed) const {
        if (!is_governed) return World(workload, *make_bare(), settings).run();
        GovernedSubject subject(configured(workload, settings.scenario, *config::preset("urgengo")),
                                profiled(workload, settings.traits));
        return World(workload, subject, settings).run();
    }
};

/// Marks, by the branch that they are on.
struct Marks final : MarkPort {
    void mark(int, int branch, nanoseconds, std::int64_t) override { on.push_back(branch); }
    std::vector<int> on;
};

}  // namespace

TEST_CASE("A task over several streams takes alone what its critical path takes", "[unit][sim]") {
    for (const bool is_governed : {false, true}) {
        Program program;
        const Forked forked = diamond();
        program.add(20, 20, forked.task, forked.traits);
        program.settings.seconds = 2;
        const auto report = program.run(is_governed);
        REQUIRE(report.chains[0].latency);
        INFO(is_governed);
        // The first stream, the second, the first again; waking up and computing.
        CHECK(report.chains[0].latency->mean_ms ==
              Approx(0.03 + 0.5 + 0.1 + 0.4 + 0.05).epsilon(0.03));
    }
}

TEST_CASE("What a kernel beside a longer one adds to the time that the GPU is busy is nothing",
          "[unit][sim]") {
    const Forked forked = diamond();
    const BranchTimes times =
        branch_times({100us, 400us, 100us, 200us, 50us}, forked.traits, kLaunch, {});
    CHECK(times.adds == std::vector<nanoseconds>{100us, 400us, 0us, 0us, 50us});
    // Two gaps, and the first launch's way to the GPU.
    CHECK(times.latency == 550us + 2 * 1'500ns + GpuShape{}.start);
}

TEST_CASE("At moderate load a forked task is not worse off under urgengo than bare",
          "[unit][sim]") {
    double bare = 0, urgengo = 0, forked_bare = 0, forked_urgengo = 0;
    for (const std::uint32_t seed : {1U, 2U, 3U, 4U}) {
        Program program;
        // 0.7 of the GPU's time is asked for, all told.
        const Forked forked = diamond(4, 66);
        program.add(20, 5, forked.task, forked.traits);
        program.add(20, 18, line(150, 30, 528));
        program.add(25, 23, line(150, 40, 528));
        program.add(30, 28, line(300, 18, 528));
        program.settings.seconds = 8;
        program.settings.frames = recorded_frames(program.workload, {}, 8, seed);
        const auto without = program.run(false), with = program.run(true);
        bare += without.overall_miss_ratio();
        urgengo += with.overall_miss_ratio();
        forked_bare += without.chains[0].miss_ratio();
        forked_urgengo += with.chains[0].miss_ratio();
    }
    CHECK(forked_bare > 1);
    CHECK(urgengo <= bare);
    CHECK(forked_urgengo < 0.5 * forked_bare);
}

TEST_CASE("A run of forked tasks repeats", "[unit][sim]") {
    Program program;
    const Forked forked = diamond();
    program.add(8, 3, forked.task, forked.traits);
    program.add(20, 18, line(150, 30, 528));
    program.settings.seconds = 2;
    for (const bool is_governed : {false, true})
        CHECK(chains::format_json(program.run(is_governed), true) ==
              chains::format_json(program.run(is_governed), true));
}

TEST_CASE("A mark is only where the program's order puts all of the task before it",
          "[unit][sim]") {
    Program program;
    Forked forked;
    forked.launch(100, 0);
    forked.launch(400, 1, {0});
    forked.launch(600, 2, {0});
    forked.launch(50, 0, {1, 2});
    forked.launch(400, 0);
    program.add(20, 20, forked.task, forked.traits);
    program.add(20, 20, forked.task, forked.traits);
    GovernedSubject subject(
        configured(program.workload, program.settings.scenario, *config::preset("urgengo")),
        profiled(program.workload, program.settings.traits));
    Marks marks;
    subject.connect(marks);
    for (const int chain : {0, 1}) {
        subject.arrived(chain, 0ms, 0ms);
        subject.task_begins({chain, 0, 0}, 0ms, 0ms);
    }
    // Somebody else is there, so that marks are wanted at once.
    REQUIRE(subject.launch({1, 0, 0}, 1ms).goes);
    subject.launched({1, 0, 0}, 1ms);
    marks.on.clear();
    for (std::size_t i = 0; i < forked.traits.launches.size(); ++i) {
        const LaunchTraits& its = forked.traits.launches[i];
        const Place at{0, 0, i, its.branch};
        for (const int other : its.after) subject.joined(at, its.branch, other, 1ms);
        REQUIRE(subject.launch(at, 1ms).goes);
        subject.launched(at, 1ms);
    }
    REQUIRE(!marks.on.empty());
    // The second stream joined all that was there before it; the third left the second beside it.
    for (const int branch : marks.on) CHECK(branch != 2);
    CHECK(marks.on.back() == 0);
}

TEST_CASE("A recorded task that leaves its stream forks, and joins when it is back",
          "[unit][sim]") {
    config::Config config;
    config.chains.push_back({});
    config.chains[0].name = "a";
    config.chains[0].tasks.push_back({"infer"});
    config::Profile profile;
    profile.chains.push_back({"a", {{"infer"}}});
    config::TaskProfile& task = profile.chains[0].tasks[0];
    for (const std::uint32_t stream : {0U, 1U, 2U, 1U, 0U, 3U}) {
        config::KernelProfile its;
        its.name = "k";
        its.grid_blocks = 1;
        its.block_threads = 32;
        its.stream = stream;
        task.kernels.push_back(its);
    }
    const auto program = recorded(config, profile);
    REQUIRE(program);
    const TaskTraits& traits = program->traits[0].tasks[0];
    const std::vector<std::vector<int>> after = {{}, {0}, {0}, {}, {1, 2}, {0}};
    for (std::size_t i = 0; i < after.size(); ++i) CHECK(traits.launches[i].after == after[i]);
    CHECK(traits.joins == std::vector<int>{3});
    CHECK(program->traits[0].num_branches() == 4);
}
