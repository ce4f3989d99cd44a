// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/report.h"

#include <sys/prctl.h>

#include <string>
#include <vector>

#include "tests/support/runtime_parts.h"

using namespace urgengo;
using namespace urgengo::testing;
using runtime::Report;
using runtime::TaskState;
using Lines = std::vector<std::string>;

namespace {

struct Fixture : RuntimeParts {
    explicit Fixture(const config::Config& config = two_chains()) : RuntimeParts(config) {
        for (const auto& chain : chains) instances.add_chain(*chain);
        for (const auto& task : tasks) names.add_task(task->index, task->known_by.config, false);
    }
    /// All tasks have launched, and as they should.
    void launch_all() {
        for (const auto& task : tasks) {
            task->known_by.matched = true;
            task->counters.launches = 1;
        }
    }
    const observe::ChainStatistics& stats(std::size_t chain) {
        return *report.statistics().at(chain);
    }

    identity::Instances instances;
    identity::TaskNames names;
    Report report{{clock, governor, guard, instances, names, chains, tasks}};
};

config::Config one_chain(std::vector<config::Task> tasks) {
    config::Config config = RuntimeParts::two_chains();
    config.chains.resize(1);
    config.chains[0].tasks = std::move(tasks);
    return config;
}

/// The calling thread has this name for a moment, and it is seen.
void see_name(identity::TaskNames& names, const char* name) {
    char old[16] = {};
    prctl(PR_GET_NAME, old);
    prctl(PR_SET_NAME, name);
    identity::NamedThread thread;
    names.read(thread);
    prctl(PR_SET_NAME, old);
}

}  // namespace

TEST_CASE("A report adds up what the tasks of a chain have counted", "[runtime][report]") {
    config::Config config = RuntimeParts::two_chains();
    config.chains[1].tasks.push_back({"track", "th_track"});
    Fixture f(config);
    for (std::size_t i = 0; i < 3; ++i) {
        auto& counters = f.task(i).counters;
        const std::uint64_t n = i + 1;
        counters.launches = 100 * n;
        counters.scheduled = 90 * n;
        counters.marks = 10 * n;
        counters.holds = n;
        counters.held_ns = static_cast<std::int64_t>(1000 * n);
        counters.unknown = 7 * n;
        f.task(i).copies.num_cut = 20 * n;
    }
    for (int asked = 0; asked < 2; ++asked) {  // as often as it is asked for
        CHECK(f.stats(0).name == "tight");
        CHECK(f.stats(0).tasks.launches == 100);
        CHECK(f.stats(1).tasks.launches == 500);
        CHECK(f.stats(1).tasks.scheduled == 450);
        CHECK(f.stats(1).tasks.marks == 50);
        CHECK(f.stats(1).tasks.holds == 5);
        CHECK(f.stats(1).tasks.held_ns == 5000);
        CHECK(f.stats(1).tasks.unknown == 35);
        CHECK(f.stats(1).copies_cut == 100);
    }
    CHECK(f.stats(0).guard.load() == std::string("enforce"));
}

TEST_CASE("A report has the launches that went as planned and are not counted yet",
          "[runtime][report]") {
    Fixture f;
    f.task(0).counters.launches = f.task(0).counters.scheduled = 10;
    f.task(0).slot->as_planned = 25;
    f.task(0).unasked.counted = 20;
    CHECK(f.stats(0).tasks.launches == 15);
    CHECK(f.stats(0).tasks.scheduled == 15);
    CHECK(f.stats(0).as_planned == 25);
    CHECK(f.stats(1).tasks.launches == 0);
}

TEST_CASE("A report counts a frame that never came to its end as missed, once, when it is late",
          "[runtime][report]") {
    Fixture f;
    f.instances.arrived(0, f.clock.now());
    f.clock.advance(19ms);
    CHECK(f.stats(0).frames.missed == 0);
    f.clock.advance(2ms);
    CHECK(f.stats(0).frames.missed == 1);
    CHECK(f.stats(0).frames.misses_in_a_row == 1);
    f.clock.advance(100ms);
    CHECK(f.stats(0).frames.missed == 1);
    CHECK(f.stats(1).frames.missed == 0);
}

TEST_CASE("A report warns of nothing where all is well, or nothing was launched",
          "[runtime][report]") {
    Fixture f;
    CHECK(f.report.warnings().empty());
    f.launch_all();
    CHECK(f.report.warnings().empty());
}

TEST_CASE("A report says what would have matched a task, and which names were seen",
          "[runtime][report]") {
    config::Task by_range{"range"}, by_kernel{"kernel"}, by_hint{"hint"};
    by_range.nvtx_glob = "plan*";
    by_kernel.kernels = {{"conv*", 0, 0}, {"other", 0, 0}};
    SECTION("where others matched") {
        Fixture f(one_chain({{"thread", "th_*"}, by_range, by_kernel, by_hint}));
        f.task(3).known_by.matched = true;
        f.task(3).counters.launches = 1;
        CHECK(f.report.warnings() ==
              Lines{"warning: nothing matched task 'thread' of chain 'tight' (thread: 'th_*'), "
                    "'range' of chain 'tight' (nvtx: 'plan*'), 'kernel' of chain 'tight' "
                    "(kernels: 'conv*'); threads that launched and matched nothing: none"});
    }
    SECTION("where nothing has") {
        Fixture f(one_chain({{"thread", "th_*"}, by_hint}));
        see_name(f.names, "worker");
        see_name(f.names, "th_1");
        see_name(f.names, "main");
        f.task(0).known_by.matched = true;
        CHECK(f.report.warnings() ==
              Lines{"warning: nothing matched task 'hint' of chain 'tight' (hints only); threads "
                    "that launched and matched nothing: 'main', 'worker'"});
    }
}

TEST_CASE("A report tells of arrivals and starts that are not what they should be",
          "[runtime][report]") {
    Fixture f;
    f.launch_all();
    auto& stats = f.chain(1).statistics;
    SECTION("where a hint's clock cannot be right") {
        stats.frames.instances = 7;
        stats.frames.implausible = 3;
        CHECK(f.report.warnings() ==
              Lines{"warning: 3 of 7 arrivals that hints told of chain 'loose' are implausible "
                    "(another clock?): the time of the call was taken instead"});
    }
    SECTION("where many frames start late") {
        stats.frames.instances = 150;
        stats.frames.late_starts = 9;
        CHECK(f.report.warnings().empty());  // too few
        stats.frames.late_starts = 10;
        const Lines lines = f.report.warnings();
        REQUIRE(lines.size() == 1);
        CHECK(lines[0].find("warning: 10 of 150 frames of chain 'loose' started late") == 0);
        stats.frames.instances = 200;
        CHECK(f.report.warnings().empty());  // a twentieth
    }
}

TEST_CASE("A report says that the host's cores were busy, unless chains have a nice value",
          "[runtime][report]") {
    Fixture f;
    f.launch_all();
    sched::CoreLoad cores;
    nanoseconds now{1s};
    const auto sleep_for = [&](nanoseconds time, nanoseconds late) {
        for (const nanoseconds end = now + time; now < end;) {
            now += 50us + late;
            cores.slept(50us, 50us + late, now);
        }
    };
    const auto warnings = [&](bool has_nice) {
        return Report({f.clock, f.governor, f.guard, f.instances, f.names, f.chains, f.tasks,
                       nullptr, &cores, has_nice})
            .warnings();
    };
    sleep_for(4s, 4ms);
    CHECK(warnings(false).empty());  // too few
    sleep_for(6s, 0ms);
    const Lines lines = warnings(false);
    REQUIRE(lines.size() == 1);
    CHECK(lines[0].find("warning: the host's cores were busy: threads that were held woke up late "
                        "in 4") == 0);
    CHECK(warnings(true).empty());
    sleep_for(40s, 0ms);
    CHECK(warnings(false).empty());  // a tenth
}

TEST_CASE("A report asks for a new profile where this one is of something else",
          "[runtime][report]") {
    Fixture f;
    f.launch_all();
    SECTION("by its kernels") {
        auto& counters = f.task(0).counters;
        counters.scheduled = 99;
        counters.unknown = 99;
        CHECK(f.report.warnings().empty());  // too few
        counters.scheduled = 1000;
        counters.unknown = 50;
        CHECK(f.report.warnings().empty());
        counters.unknown = 60;
        CHECK(f.report.warnings() ==
              Lines{"warning: the profile does not know 6 % of the launches of chain 'tight': run "
                    "`urgengo profile` again"});
    }
    SECTION("by their times, if it has any") {
        f.task(1).slot->factor_ppm = 2'000'000;
        CHECK(f.report.warnings().empty());
        config::TaskProfile profile;
        profile.name = "detect";
        profile.kernels = {{"conv", 1, 32, 1ms, 1.0}};
        f.task(1).plan = model::TaskPlan(profile);
        CHECK(f.report.warnings() ==
              Lines{"warning: GPU times of task 'detect' of chain 'loose' were 2.00 times what the "
                    "profile says, and were corrected: run `urgengo profile` again"});
        for (const std::uint32_t ppm : {0u, 1'000'000u, 1'240'000u, 810'000u}) {
            f.task(1).slot->factor_ppm = ppm;
            CHECK(f.report.warnings().empty());
        }
        f.task(1).slot->factor_ppm = 790'000;
        CHECK(f.report.warnings().size() == 1);
    }
}

TEST_CASE("A report says why no launch was held, or not for long", "[runtime][report]") {
    Fixture f;
    f.launch_all();
    SECTION("as the program jumped out") {
        f.report.jumped();
        f.report.jumped();
        CHECK(f.report.warnings() ==
              Lines{"warning: the program jumped out of a held launch (siglongjmp): 2 times"});
    }
    SECTION("as looking took too much of a core") {
        auto& polls = f.governor.polls();
        for (int i = 0; i < 40 && polls.num_ends() == 0; ++i) {
            const auto begin = f.clock.now();
            f.clock.advance(90ms);
            polls.looked(begin, f.clock.now());
            f.clock.advance(10ms);
        }
        REQUIRE(polls.num_ends() == 1);
        CHECK(f.report.warnings() ==
              Lines{"warning: looks of held launches took more than 20 % of a core, so no launch "
                    "was held for a second: 1 times"});
    }
    SECTION("as a bystander kept the GPU busy") {
        while (!f.governor.bystanders().are_busy()) f.governor.bystanders().saw(true);
        const Lines lines = f.report.warnings();
        REQUIRE(lines.size() == 1);
        CHECK(lines[0].find("warning: work of no chain kept the GPU busy") == 0);
        CHECK(lines[0].find("No launch was held then") != std::string::npos);
    }
    SECTION("of a task on more streams than are followed") {
        f.task(1).streams.were_lost = true;
        const Lines lines = f.report.warnings();
        REQUIRE(lines.size() == 1);
        CHECK(lines[0].find("warning: task 'detect' of chain 'loose' uses more than") == 0);
    }
}
