// SPDX-License-Identifier: Apache-2.0
//
// Another config for a program under load, while it runs on the simulated GPU.
#include "tests/interposer/steered.h"

using namespace urgengo;
using namespace urgengo::testing;
using config::Config;
using config::Mode;

namespace {

constexpr nanoseconds kBefore = 20ms, kAfter = 30ms;

bool are_deadlines(const cli::PageReading& page, nanoseconds deadline) {
    for (std::size_t i = 0; i < page.chains.size(); ++i)
        if (page.chains[i].deadline != static_cast<int>(i + 1) * deadline) return false;
    return true;
}

}  // namespace

TEST_CASE("Config is reloaded a hundred times under load, and results are right",
          "[interposer][reload]") {
    Steered program(Mode::kEnforce, kBefore);
    const std::string configs[] = {program.write(Mode::kEnforce, "after.json", kAfter,
                                                 [](Config& c) {
                                                     c.chains[0].criticality = 3;
                                                     c.chains[1].on_late = config::OnLate::kDemote;
                                                     c.chains[2].mode = Mode::kObserve;
                                                     c.chains[3].max_consecutive_misses = 2;
                                                 }),
                                   program.write(Mode::kEnforce, "before.json", kBefore)};
    for (int i = 0; i < 100; ++i) {
        const std::uint32_t word = program.reload(configs[i % 2]);
        const auto page = program.page();
        INFO(page.text);
        CHECK(cli::refusal(page, word) == "");
        CHECK(cli::told(page, word).find("chain 'steered_0': criticality") != std::string::npos);
        CHECK(are_deadlines(page, i % 2 == 0 ? kAfter : kBefore));
        CHECK(page.chains[2].mode ==
              (i % 2 == 0 ? abi::StatusMode::kObserve : abi::StatusMode::kEnforce));
        if (i % 10 == 0) program.wait_for_frames(2);
    }
    CHECK(program.page().control_refused == 0);
    program.wait_for_frames(20);
    check_results(program.end());
}

TEST_CASE("Config that only a new start can change is refused as a whole, and why is told",
          "[interposer][reload]") {
    const Steered program(Mode::kEnforce, kBefore);
    const auto refused = [&](const std::string& config, const std::string& why) {
        const std::uint32_t word = program.reload(config);
        const auto page = program.page();
        INFO(page.text);
        CHECK(cli::refusal(page, word).find(why) != std::string::npos);
        CHECK(are_deadlines(page, kBefore));
        CHECK(page.chains.front().mode == abi::StatusMode::kEnforce);
    };
    refused(program.write(Mode::kEnforce, "a.json", kAfter,
                          [](Config& c) { c.chains[1].name = "renamed"; }),
            "only a new start changes this: chain 'steered_1' is gone; chain 'renamed' is new");
    refused(program.write(Mode::kEnforce, "b.json", kAfter,
                          [](Config& c) { c.scheduler.parameters.lambda = 0.5; }),
            "scheduler: lambda");
    refused("/nonexistent/c.json", "is no file of this process' user");
    refused("relative.json", "is no file of this process' user");
    write_text(program.folder() + "/wrong.json", "{\"format_version\": 7}");
    refused(program.folder() + "/wrong.json", "wrong.json");
    CHECK(program.page().control_refused == 5);
    program.wait_for_frames(10);
}

TEST_CASE("Reloaded mode is the program's, and what it is switched on to", "[interposer][reload]") {
    const Steered program(Mode::kEnforce, kBefore);
    program.reload(program.write(Mode::kObserve, "observe.json", kBefore));
    CHECK(program.page().mode == abi::StatusMode::kObserve);
    program.steer(abi::ControlCommand::kOff);
    program.steer(abi::ControlCommand::kOn);
    CHECK(program.page().mode == abi::StatusMode::kObserve);
    program.reload(program.write(Mode::kEnforce, "enforce.json", kAfter));
    CHECK(program.page().mode == abi::StatusMode::kEnforce);
    program.wait_for_frames(10);
}

TEST_CASE("urgengo ctl reload validates a config before the program sees it",
          "[interposer][reload]") {
    Steered program(Mode::kEnforce, kBefore);
    const Folder folder;
    const std::string yaml = (folder.path() / "chains.yaml").string();
    const auto write = [&](int deadline_ms, const char* more) {
        std::string text =
            "version: 1\nscheduler: {guard: off, hold: {max_per_instance_ms: 40}}\nchains:\n";
        for (int i = 0; i < 4; ++i) {
            const auto number = std::to_string(i);
            text += "  - {name: steered_" + number +
                    ", period_ms: " + std::to_string((i + 1) * 20) +
                    ", deadline_ms: " + std::to_string((i + 1) * deadline_ms) + more +
                    ", tasks: [{name: work" + (i % 2 == 0 ? "" : ", thread: steered_" + number) +
                    "}]}\n";
        }
        write_text(yaml, text);
    };
    const auto reload = [&](std::vector<std::string> more = {}) {
        more.insert(more.begin(), {URGENGO_PATH, "ctl", "reload", "-c", yaml});
        return run(more, {{"PATH", "/usr/bin:/bin"}, {"URGENGO_SHARE", program.folder()}});
    };
    write(30, "");
    const Outcome done = reload();
    INFO(done.err);
    CHECK(done.exit_status == 0);
    CHECK(done.out.find("done: chain 'steered_0': deadline_ms 20.0 -> 30.0") != std::string::npos);
    CHECK(are_deadlines(program.page(), kAfter));

    write(40, ", dedline_ms: 1");
    const Outcome wrong = reload();
    CHECK(wrong.exit_status == 2);
    CHECK(wrong.err.find("dedline_ms") != std::string::npos);
    write(40, ", arrival: {from: hint}");
    const Outcome refused = reload({"--json"});
    CHECK(refused.exit_status == 1);
    CHECK(refused.err.find("only a new start changes this: chain 'steered_0': arrival") !=
          std::string::npos);
    CHECK(are_deadlines(program.page(), kAfter));
    CHECK(reload({"--chain", "steered_0"}).exit_status == 2);
    const Outcome outcome = program.end();
    CHECK(outcome.err.find("urgengo: reloaded ") != std::string::npos);
    check_results(outcome);
}
