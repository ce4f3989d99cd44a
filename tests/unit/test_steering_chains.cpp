// SPDX-License-Identifier: Apache-2.0
//
// Words about one chain, and another config for all of them.
#include <fstream>

#include "host/runtime/steering.h"
#include "tests/support/folder.h"
#include "tests/support/steering_fixture.h"

using namespace urgengo;
using namespace urgengo::testing;
using abi::ControlCommand;
using abi::StatusMode;
using config::Mode;
using Fixture = SteeringFixture;

TEST_CASE("Steering one chain ends its hold at its next look, and the others go on",
          "[runtime][steering]") {
    Fixture f;
    f.begin_both();
    const auto command = GENERATE(ControlCommand::kChainOff, ControlCommand::kChainObserve);
    f.clock.on_sleep = [&] {
        f.clock.on_sleep = {};  // it sleeps itself, until the hold has ended
        f.steer(command, 1);
    };
    const Grant held = f.launch(f.thread_b, kStreamB);
    CHECK(held.task != nullptr);
    CHECK(f.header().holds_left == 1);  // obeyed inside the hold
    CHECK(f.result() == abi::ControlResult::kDone);
    CHECK(f.header().mode == StatusMode::kEnforce);
    const bool is_off = command == ControlCommand::kChainOff;
    const StatusMode mode = is_off ? StatusMode::kOff : StatusMode::kObserve;
    CHECK(f.rt().status().chain(1).allowed_mode == static_cast<std::uint32_t>(mode) + 1);
    CHECK(f.rt().status().chain(0).allowed_mode == 0);
    CHECK((f.page().tasks[1].state == abi::TaskState::kIdle) == is_off);
    // The launches of the chain wait no more, nor get a priority; the other's are scheduled.
    const int sleeps = f.clock.num_sleeps;
    const Grant next = f.launch(f.thread_b, kStreamB);
    CHECK((next.task == nullptr) == is_off);
    CHECK_FALSE(next.scheduled);
    CHECK_FALSE(next.set_priority);
    CHECK(f.clock.num_sleeps == sleeps);
    CHECK(f.page().on_gpu == 1);
    CHECK(f.launch(f.thread_a).scheduled);
}

TEST_CASE("Chain in shadow is decided about and nothing of that is done, while the others go on",
          "[runtime][steering]") {
    Fixture f;
    const bool is_configured = GENERATE(false, true);
    if (is_configured) f.resolved.config.chains[1].mode = Mode::kShadow;
    f.begin_both();
    if (!is_configured) {
        f.clock.on_sleep = [&] {
            f.clock.on_sleep = {};  // it sleeps itself, until the hold has ended
            f.steer(ControlCommand::kChainShadow, 1);
        };
        CHECK(f.launch(f.thread_b, kStreamB).set_priority);  // it was held
        CHECK(f.header().holds_left == 1);                   // obeyed inside the hold
        CHECK(f.rt().status().chain(1).allowed_mode ==
              static_cast<std::uint32_t>(StatusMode::kShadow) + 1);
    }
    CHECK(f.header().mode == StatusMode::kEnforce);
    const int sleeps = f.clock.num_sleeps;
    const auto marks = f.driver.marks.size();
    const auto holds = f.stats(1).tasks.holds.load();
    for (int i = 0; i < 5; ++i) {
        const Grant grant = f.launch(f.thread_b, kStreamB);
        CHECK(grant.scheduled);
        CHECK_FALSE(grant.set_priority);
        f.clock.advance(100us);
    }
    CHECK(f.clock.num_sleeps == sleeps);
    CHECK(f.driver.marks.size() > marks);  // it is known where the GPU is
    CHECK(f.page().on_gpu == 2);           // and the others reckon with it
    CHECK(f.launch(f.thread_a).set_priority);
    f.driver.execute_marks(100);
    f.wait(f.thread_b, kStreamB);
    f.rt().frames().task_end(f.thread_b);
    CHECK(f.rt().status().chain(1).would_hold > 0);
    CHECK(f.rt().status().chain(1).would_behind == 1);
    CHECK(f.rt().status().chain(0).would_hold == 0);
    CHECK(f.stats(1).tasks.holds == holds);
    // What it is switched to stands from the next instance on.
    if (is_configured) return;
    f.steer(ControlCommand::kChainOn, 1);
    f.begin(f.thread_b, "loose");
    f.driver.execute_marks(100);
    CHECK(f.launch(f.thread_b, kStreamB).set_priority);
}

TEST_CASE("Steering one chain off leaves no run of it behind, and what comes after on is a new one",
          "[runtime][steering]") {
    Fixture f;
    f.begin_both();
    f.steer(ControlCommand::kChainOff, 0);
    CHECK(f.page().tasks[0].state == abi::TaskState::kIdle);
    CHECK(f.launch(f.thread_a).task == nullptr);
    CHECK(f.rt().frames().arrival(nullptr, "tight", f.clock.now()) == 0);
    CHECK(f.rt().frames().arrival(nullptr, "loose", f.clock.now()) != 0);
    f.steer(ControlCommand::kChainOn, 0);
    f.begin(f.thread_a, "tight");
    CHECK(f.launch(f.thread_a).scheduled);
    CHECK(f.rt().status().chain(0).allowed_mode ==
          static_cast<std::uint32_t>(StatusMode::kEnforce) + 1);
}

TEST_CASE("Chain that is switched off takes no frame that its hints have told of before",
          "[runtime][steering]") {
    Fixture f;
    const auto token = f.rt().frames().arrival(nullptr, "tight", f.clock.now());
    f.steer(ControlCommand::kChainOff, 0);
    CHECK_FALSE(f.rt().frames().task_begin(f.thread_a, token, "detect"));
    CHECK(f.launch(f.thread_a).task == nullptr);
    f.rt().frames().task_end(f.thread_a);
    CHECK(f.stats(0).frames.finished == 0);
}

TEST_CASE("Chain without hints that is switched off is counted no more", "[runtime][steering]") {
    Fixture f;
    f.close_segments();
    const ThreadName name("th_tight");
    f.steer(ControlCommand::kChainOff, 0);
    CHECK(f.launch(f.thread_a).task == nullptr);
    f.wait(f.thread_a, kStreamA);
    CHECK(f.stats(0).frames.instances == 0);
    f.steer(ControlCommand::kChainOn, 0);
    CHECK(f.launch(f.thread_a).task != nullptr);
    CHECK(f.stats(0).frames.instances == 1);
}

TEST_CASE("Instance that is only looked at since it was steered stays so to its end",
          "[runtime][steering]") {
    Fixture f;
    f.begin(f.thread_a, "tight");
    f.launch(f.thread_a);
    f.steer(ControlCommand::kChainObserve, 0);
    for (int i = 0; i < 5; ++i) CHECK_FALSE(f.launch(f.thread_a).scheduled);
    CHECK(f.page().on_gpu == 0);
    CHECK(f.stats(0).tasks.launches == 6);
    f.steer(ControlCommand::kChainOn, 0);
    CHECK_FALSE(f.launch(f.thread_a).scheduled);
    f.rt().frames().task_end(f.thread_a);
    f.begin(f.thread_a, "tight");
    CHECK(f.launch(f.thread_a).scheduled);
}

TEST_CASE("Launches of a steered chain need asking again", "[runtime][steering]") {
    Fixture f;
    f.resolved.config.scheduler.progress.mark_every =
        250us;  // alone, half of the run-ahead: five kernels
    f.close_segments();
    f.begin(f.thread_a, "tight");
    const Launch launch{kConv, 100, 256, kStreamA};
    bool skipped = false;
    for (int i = 0; i < 4 && !skipped; ++i) skipped = f.launch_as_interposed(f.thread_a, launch);
    REQUIRE(skipped);
    f.steer(ControlCommand::kChainObserve, 0);
    const std::uint64_t scheduled = f.stats(0).tasks.scheduled;
    CHECK_FALSE(f.launch_as_interposed(f.thread_a, launch));
    for (int i = 0; i < 4; ++i) f.launch_as_interposed(f.thread_a, launch);
    CHECK(f.stats(0).tasks.scheduled == scheduled);
    CHECK(f.page().on_gpu == 0);
}

TEST_CASE("Weaker one of a chain's mode and that of all holds", "[runtime][steering]") {
    Fixture f;
    f.steer(ControlCommand::kChainObserve, 0);
    f.steer(ControlCommand::kOff);
    CHECK(f.rt().frames().arrival(nullptr, "tight", f.clock.now()) == 0);
    f.steer(ControlCommand::kOn);
    f.begin(f.thread_a, "tight");
    CHECK_FALSE(f.launch(f.thread_a).scheduled);
}

TEST_CASE("Steering refuses a chain that there is not", "[runtime][steering]") {
    Fixture f;
    const auto chain = GENERATE(2u, 255u, ~0u);
    f.steer(ControlCommand::kChainOff, chain);
    CHECK(f.result() == abi::ControlResult::kNoChain);
    CHECK(f.header().control_refused == 1);
    CHECK(f.header().control_seen == f.word);
    f.steer(ControlCommand::kChainOff);  // a word that says nothing besides
    CHECK(f.result() == abi::ControlResult::kNoChain);
    f.steer(ControlCommand{200}, 0);
    CHECK(f.result() == abi::ControlResult::kMeansNothing);
    f.rt().trip();
    f.steer(ControlCommand::kChainOn, 0);
    CHECK(f.result() == abi::ControlResult::kOffForGood);
    CHECK(f.header().control_refused == 4);
}

namespace {

/// With a page, so that a path can be told by it.
struct Reloaded : SteeringFixture {
    const MemoryFolder folder;

    Reloaded() {
        resolved.config.scheduler.run_ahead.alone = 1ms;  // a file may not say 0
        runtime = std::make_unique<Runtime>(resolved, driver.api, clock, runtime::TraceOptions{}, 0,
                                            observe::ShareOptions{folder.path().string(), ""});
    }
    void name(const std::string& path) {
        std::fstream control(rt().status().stem() + observe::kControlSuffix,
                             std::ios::binary | std::ios::in | std::ios::out);
        control.seekp(offsetof(abi::ControlPage, path));
        control.write(path.c_str(), static_cast<std::streamsize>(path.size() + 1));
    }
    /// @returns what the reader of the page is told
    std::string reload(const std::string& path) {
        name(path);
        steer(ControlCommand::kReload, ~0u);
        return header().text;
    }
};

}  // namespace

TEST_CASE("Reloaded terms of a chain are those of instances that begin from then on",
          "[runtime][steering]") {
    Reloaded f;
    config::Config next = f.resolved.config;
    next.chains[0].period = 5s;
    next.chains[0].deadline = 150ms;
    next.chains[0].criticality = 7;
    next.chains[0].on_late = config::OnLate::kDemote;
    const std::string path = f.folder.path("next.json");
    std::ofstream(path) << config::to_resolved_json(next, nullptr, {});
    f.name(path);

    f.begin_both();
    const abi::TaskSlot& slot = f.page().tasks[0];
    CHECK(slot.static_rank == 0);
    const std::int64_t deadline_ns = slot.deadline_ns;
    f.steer(ControlCommand::kReload, ~0u);
    INFO(f.header().text);
    REQUIRE(f.result() == abi::ControlResult::kDone);
    CHECK(std::string(f.header().text).find("criticality 1 -> 7") != std::string::npos);
    CHECK(f.header().text_word == f.word);
    CHECK(slot.deadline_ns == deadline_ns);
    CHECK(slot.relative_deadline_ns == 20'000'000);
    CHECK(slot.static_rank == 1);
    f.rt().frames().task_end(f.thread_a);

    f.begin(f.thread_a, "tight");
    CHECK(slot.deadline_ns == (f.clock.now() + 150ms).count());
    CHECK(slot.relative_deadline_ns == 150'000'000);
    CHECK(slot.criticality == 7);
    CHECK(slot.demotes == 1);
    f.clock.advance(100ms);
    f.rt().frames().task_end(f.thread_a);
    CHECK(f.stats(0).frames.missed == 0);
    CHECK(f.rt().status().chain(0).deadline_ns == 150'000'000);

    std::ofstream(path) << "{}";
    f.steer(ControlCommand::kReload, ~0u);
    CHECK(f.result() == abi::ControlResult::kRefused);
    CHECK(f.rt().status().chain(0).deadline_ns == 150'000'000);
    CHECK(f.header().control_refused == 1);
}

TEST_CASE("What is refused as a config tells nothing of what is in it", "[runtime][steering]") {
    Reloaded f;
    const std::string secret = R"({"format_version": "hunter2"})";
    SECTION("the process' user's own") {
        const std::string told = f.reload(f.folder.write("own.json", secret, 0600));
        CHECK(told.find("is no config that can be taken") != std::string::npos);
        CHECK(told.find("hunter2") == std::string::npos);
    }
    SECTION("the resolved file beside a YAML") {
        f.folder.write("own.resolved.json", secret, 0600);
        const std::string told = f.reload(f.folder.write("own.yaml", "chains: []\n", 0600));
        CHECK(told.find("hunter2") == std::string::npos);
    }
    SECTION("one that a link names, as the file itself or beside a YAML") {
        config::Config next = f.resolved.config;
        next.chains[0].deadline = 150ms;
        const std::string real =
            f.folder.write("real.json", config::to_resolved_json(next, nullptr, {}), 0600);
        std::filesystem::create_symlink(real, f.folder.path("link.json"));
        std::filesystem::create_symlink(real, f.folder.path("own.resolved.json"));
        const std::string yaml = f.folder.write("own.yaml", "chains: []\n", 0600);
        const std::string named = GENERATE(true, false) ? yaml : f.folder.path("link.json");
        CHECK(f.reload(named) == named + ": is no file of this process' user");
    }
    CHECK(f.result() == abi::ControlResult::kRefused);
    CHECK(f.header().control_refused == 1);
}
